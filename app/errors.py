"""What a request may be refused for, by name; `web.py` turns each into an RFC 9457 answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class Refusal(Exception):
    """A request that cannot be served, for a reason that its sender should read.

    Attributes:
        status: the HTTP status.
        code: the stable name of the reason.
        detail: what is wrong and what to do, in a sentence.
        errors: the single problems, as `evaluator.errors.Problem.as_json` shapes them.
    """

    status = 400
    code = "bad_request"
    title = "The request cannot be understood"

    def __init__(self, detail: str, *, code: str | None = None, errors: Sequence[dict[str, Any]] = ()) -> None:
        """Say what is wrong."""
        super().__init__(detail)
        self.detail, self.errors = detail, list(errors)
        if code:
            self.code = code


class Unauthenticated(Refusal):
    """Nobody, or nobody known, is asking."""

    status, code, title = 401, "unauthenticated", "Sign in or send a token"


class Forbidden(Refusal):
    """Somebody known is asking for what is not theirs to do."""

    status, code, title = 403, "forbidden", "Not allowed"


class NotFound(Refusal):
    """There is no such thing, or it is somebody else's and private."""

    status, code, title = 404, "not_found", "Not found"


class Conflict(Refusal):
    """The thing's state does not allow it."""

    status, code, title = 409, "conflict", "Not possible in this state"


class TooLarge(Refusal):
    """More bytes than may be sent."""

    status, code, title = 413, "too_large", "The upload is too large"


class UnsupportedMedia(Refusal):
    """A body of another type than this route takes."""

    status, code, title = 415, "unsupported_media_type", "Unsupported type of body"


class Invalid(Refusal):
    """A field is missing or wrong."""

    status, code, title = 422, "invalid", "A field is missing or wrong"


class Broken(Refusal):
    """Something that we did not expect."""

    status, code, title = 500, "internal_error", "Our fault"
