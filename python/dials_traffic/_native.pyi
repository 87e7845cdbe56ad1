class InProcess:
    """The global simulator in this process. ``request``: the first order; ``memory``: a descriptor."""

    def __init__(self, request: bytes, memory: int) -> None: ...
    def about(self) -> str:
        """Return what the environment says of itself, as JSON."""
    def order(self, tag: int, payload: bytes) -> bytes:
        """Do what is ordered, and return the payload of the answer."""

def serve(memory: int, parent: int) -> None:
    """Serve one environment to the process that started this one. For the package itself."""
