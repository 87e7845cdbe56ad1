#!/usr/bin/env python3
"""Fails if a page of a folder has a link or a picture that leads nowhere in it. Usage: dead_links.py FOLDER"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The names of places in a page, and its links."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links = set(), []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == "id":
                self.ids.add(value)
            elif name in ("href", "src") and value:
                self.links.append(value)


folder = Path(sys.argv[1]).resolve()
pages = {path: Page(path) for path in folder.rglob("*.html")}
dead = []
links = 0
for path, page in pages.items():
    for link in page.links:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        links += 1
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        target_page = pages.get(target)
        is_there = target.is_file() and target.is_relative_to(folder)
        if not is_there or (target_page and parts.fragment and unquote(parts.fragment) not in target_page.ids):
            dead.append(f"{path.relative_to(folder)}: {link}")
print(f"{len(pages)} pages, {links} links, {len(dead)} of them dead", *dead, sep="\n")
sys.exit(1 if dead or links < 100 else 0)
