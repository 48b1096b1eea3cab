"""Run pytest, and insist on a version of numpy: pytest_with_numpy.py VERSION ARGUMENT..."""

from __future__ import annotations

import sys

import numpy as np
import pytest

if __name__ == "__main__":
    wanted, *arguments = sys.argv[1:]
    print(f"numpy {np.__version__} from {np.__path__[0]}")
    if not np.__version__.startswith(f"{wanted}."):
        sys.exit(f"expected numpy {wanted}")
    sys.exit(pytest.main(arguments))
