def serve(memory: int) -> None:
    """Serve one environment to the process that started this one. For the package itself."""
