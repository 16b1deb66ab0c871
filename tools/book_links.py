#!/usr/bin/env python3
"""A preprocessor of mdBook: links that lead out of the book, to files of the repository, become the names of these files.

`docs/book.toml` names it, and mdBook calls it: with `supports RENDERER` to ask, else with the book as JSON on standard input.
"""

import json
import posixpath
import re
import sys

# [words](../path/to/file#part)
UPWARDS = re.compile(r"\[([^\]]+)\]\((\.\./[^)#]+)(?:#[^)]*)?\)")


def named(folder):
    """How a link upwards from a folder of the book is replaced: one that stays in the book is not."""
    def replaced(match):
        words, path = match.group(1), posixpath.normpath(posixpath.join(folder, match.group(2)))
        if not path.startswith("../"):
            return match.group(0)
        path = path.removeprefix("../")
        return words if path in words else f"{words} (`{path}`)"
    return replaced


def walk(items):
    for item in items:
        chapter = item.get("Chapter") if isinstance(item, dict) else None
        if chapter:
            folder = posixpath.dirname(chapter.get("path") or "")
            chapter["content"] = UPWARDS.sub(named(folder), chapter["content"])
            walk(chapter["sub_items"])


def main():
    if sys.argv[1:2] == ["supports"]:
        return
    _context, book = json.load(sys.stdin)
    # `sections` until mdBook 0.4.
    walk(book.get("items", book.get("sections", [])))
    json.dump(book, sys.stdout)


if __name__ == "__main__":
    main()
