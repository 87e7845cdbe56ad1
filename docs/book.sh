#!/usr/bin/env bash
# Makes target/book/index.html, the book of all pages in docs/SUMMARY.md. It needs mdbook on the PATH.
#
# mdBook takes pages from one folder, and ours link to files in others. So the pages and all files that they link to are
# copied with their folders. Then every link leads to the same file as on GitHub.
set -euo pipefail
cd "$(dirname "$0")/.."
source=target/book_source
rm -rf "$source" target/book
mkdir -p "$source/src"
cp docs/book.toml docs/book.css "$source"

# The paths in docs/SUMMARY.md count from docs/. Those of mdBook count from the root.
sed -e 's#](\.\./#](#' -e t -e 's#](#](docs/#' docs/SUMMARY.md > "$source/src/SUMMARY.md"
grep -oP '\]\(\K[^)]+' "$source/src/SUMMARY.md" | while read -r page; do
  cp --parents "$page" "$source/src"
  { grep -oP '\]\(\K[^)#]+' "$page" || true; } | { grep -v '://' || true; } | while read -r link; do
    cp --parents "$(realpath --relative-to=. "$(dirname "$page")/$link")" "$source/src"
  done
done

mdbook build "$source" --dest-dir "$PWD/target/book"
# mdBook makes index.html of the first page, with the links that this page has in docs/.
echo '<!DOCTYPE html><meta charset="utf-8"><title>dials-traffic</title>' \
  '<meta http-equiv="refresh" content="0; url=docs/README.html"><a href="docs/README.html">dials-traffic</a>' \
  > target/book/index.html
