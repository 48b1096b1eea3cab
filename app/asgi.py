"""What uvicorn serves: `app.asgi:app`."""

from __future__ import annotations

from app.main import make_app
from app.wiring import wire

app = make_app(wire())
