"""Events of the robot: one thread polls the database while there are listeners, and sends to all of them.

Server-sent events (WHATWG HTML, 9.2).  What a listener does not take is dropped for it; it then asks for the whole.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from lostmotion.daemon.database import DAMAGED, file_identity
from lostmotion.daemon.reader import Reader
from lostmotion.drivers.errors import LostmotionError
from lostmotion.web.cards import cards
from lostmotion.web.site import Site

__all__ = ["News", "stream"]

log = logging.getLogger(__name__)

MOST_WAITING = 100
MOST_LISTENERS = 64
BEAT_S = 5.0
"""how often the whole is sent although nothing has happened: "3 s ago" grows old, a service dies [s]"""
Event = bytes
Queue = asyncio.Queue[Event]


class News:
    """The events for listeners: ``cards`` (a list for each joint, as ``cards.cards``) whenever the database has
    changed, and every few seconds."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._listeners: dict[Queue, asyncio.AbstractEventLoop] = {}
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="news", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread."""
        self._closing = True
        self._wake.set()
        self._thread.join()

    def listen(self) -> Queue:
        """A queue of events from now on, to be given to ``leave``.  Raises LookupError where too many listen."""
        queue: Queue = asyncio.Queue(MOST_WAITING)
        with self._lock:
            if len(self._listeners) >= MOST_LISTENERS:
                raise LookupError(f"{MOST_LISTENERS} pages are open already")
            self._listeners[queue] = asyncio.get_running_loop()
        self._wake.set()
        return queue

    def leave(self, queue: Queue) -> None:
        """Ends one."""
        with self._lock:
            self._listeners.pop(queue, None)

    def _run(self) -> None:
        while not self._closing:
            self._wake.wait()
            self._wake.clear()
            self._watch()

    def _watch(self) -> None:
        """Looks at the database as long as anybody listens."""
        look: _Look | None = None
        pause = threading.Event()
        waited, sent = BEAT_S, ""
        try:
            while self._listeners and not self._closing:
                is_due = waited >= BEAT_S or self._wake.is_set()
                try:
                    look = look if look and look.is_of(self._site.database) else _Look.at(self._site, look)
                    if look.is_news() or is_due:
                        self._send("cards", cards(self._site, look.reader))
                        waited, sent = 0.0, ""
                except (LostmotionError, *DAMAGED) as error:
                    if look:
                        look.reader.close()
                    look, trouble = None, " ".join(str(error).split())
                    if is_due or trouble != sent:
                        self._send("trouble", {"text": trouble})
                        waited, sent = 0.0, trouble
                if is_due:
                    self._wake.clear()
                pause.wait(self._site.look_s)
                waited += self._site.look_s
        finally:
            if look:
                look.reader.close()

    def _send(self, name: str, document: Any) -> None:
        event = f"event: {name}\ndata: {msgspec.json.encode(document).decode()}\n\n".encode()
        with self._lock:
            listeners = list(self._listeners.items())
        for queue, loop in listeners:
            with suppress(RuntimeError):  # its loop has ended
                loop.call_soon_threadsafe(_put, queue, event)


class _Look:
    """An open database, the file it is, and what it was like when it was last looked at."""

    def __init__(self, reader: Reader, path: Path) -> None:
        self.reader = reader
        self._file = file_identity(path)
        self._revision = -1

    @classmethod
    def at(cls, site: Site, before: _Look | None) -> _Look:
        if before:
            before.reader.close()
        return cls(site.reader(), site.database)

    def is_of(self, path: Path) -> bool:
        return file_identity(path) == self._file

    def is_news(self) -> bool:
        before, self._revision = self._revision, self.reader.revision()
        return before != self._revision


def _put(queue: Queue, event: Event) -> None:
    if queue.full():  # a page that sleeps: it needs the newest only
        queue.get_nowait()
    queue.put_nowait(event)


async def stream(news: News, queue: Queue) -> AsyncIterator[Event]:
    """The body of an answer that never ends; the browser asks again 2 s after it was cut off."""
    try:
        yield b"retry: 2000\n\n"
        while True:
            yield await queue.get()
    finally:
        news.leave(queue)
