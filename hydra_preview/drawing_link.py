"""The line to usdfoliage of a window that does not wait: what it asks is answered when it is, in any order."""

import json
import os
import threading
from collections.abc import Callable

from PySide6 import QtCore

FINAL = ("foliage", "asset", "stopped", "strokes", "written", "error")  # one of these is in the last reply


class DrawingLink(QtCore.QObject):
    """Requests out, replies in; a reply goes to who asked, in the window's own thread."""

    replied = QtCore.Signal(dict)
    ended = QtCore.Signal()

    def __init__(self, request_fd: int, reply_fd: int, parent=None) -> None:
        super().__init__(parent)
        self._requests, self._replies = os.fdopen(request_fd, "wb"), os.fdopen(reply_fd, "rb")
        self._receivers: dict[int, Callable[[dict], None]] = {}
        self._last = 0
        self.replied.connect(self._deliver)
        self.ended.connect(self._receivers.clear)
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def waits(self) -> bool:
        """Whether a last reply is still to come."""
        return bool(self._receivers)

    def ask(self, receiver: Callable[[dict], None], **request) -> int:
        """Send a request; receiver is called with each reply. Returns the request's number."""
        self._last += 1
        self._receivers[self._last] = receiver
        self._send({"id": self._last, **request})
        return self._last

    def forget(self, number: int) -> None:
        """Drop what comes of a request."""
        self._receivers.pop(number, None)

    def stop_growth(self) -> None:
        self._send({"id": 0, "op": "stop"})

    def _send(self, request: dict) -> None:
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
        except OSError:
            self.ended.emit()

    def _read(self) -> None:
        for line in self._replies:
            self.replied.emit(json.loads(line))
        self.ended.emit()

    def _deliver(self, reply: dict) -> None:
        receiver = self._receivers.get(reply["id"])
        if receiver is None:
            return
        is_rough = reply.get("rough", False)
        if not is_rough and any(name in reply for name in FINAL):
            self.forget(reply["id"])
        receiver(reply)
