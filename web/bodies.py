"""The body of a request, read within a bound."""

from __future__ import annotations

from typing import TypeVar

import msgspec
from starlette.exceptions import HTTPException
from starlette.requests import Request

__all__ = ["document", "read"]

Document = TypeVar("Document")


async def read(request: Request, most: int) -> bytes:
    """The body; refused where it is longer than so many bytes."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > most:
            raise HTTPException(413, "too long")
    return body


async def document(request: Request, kind: type[Document], most: int = 10_000) -> Document:
    """The body as a JSON document of that kind; refused where it is none."""
    try:
        return msgspec.json.decode(await read(request, most), type=kind)
    except (msgspec.ValidationError, msgspec.DecodeError) as error:
        raise HTTPException(422, str(error)) from error
