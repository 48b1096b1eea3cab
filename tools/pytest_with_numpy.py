"""Run pytest as on the base install, and insist on a version of numpy: pytest_with_numpy.py VERSION ARGUMENT..."""

from __future__ import annotations

import os
import sys

import numpy as np
import pytest

if __name__ == "__main__":
    wanted, *arguments = sys.argv[1:]
    print(f"numpy {np.__version__} from {np.__path__[0]}")
    if not np.__version__.startswith(f"{wanted}."):
        sys.exit(f"expected numpy {wanted}")
    os.environ["WILDSCENES_PLAIN"] = "1"  # compiled code is built for another numpy
    sys.exit(pytest.main(arguments))
