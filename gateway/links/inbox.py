"""The one queue between receivers and the loop: bounded, and never in a receiver's way."""

from queue import Empty, SimpleQueue

from gateway.links.items import Datagram, LinkEvent

Item = Datagram | LinkEvent
PER_LINK = 60_000  # a minute at 1000 datagrams a second, five times what a busy boat sends

__all__ = ["PER_LINK", "Empty", "Inbox", "Item"]


class Inbox:
    """Items in the order of their arrival; a full inbox drops the newest datagram and counts it."""

    def __init__(self, capacity: int = PER_LINK) -> None:
        self.capacity = capacity
        self._items: SimpleQueue[Item] = SimpleQueue()  # unlike `Queue`, without a Python lock

    def put(self, item: Item) -> bool:
        """Never blocks; False where there was no room. Events are few and always find room."""
        if self._items.qsize() >= self.capacity and isinstance(item, Datagram):
            return False
        self._items.put(item)
        return True

    def get(self, timeout: float | None = None) -> Item:
        """The oldest item; raises `queue.Empty` when none comes within `timeout` [s]."""
        if timeout is None or timeout > 0:
            return self._items.get(timeout=timeout)
        return self._items.get_nowait()

    def __len__(self) -> int:
        return self._items.qsize()
