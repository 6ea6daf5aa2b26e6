"""The one place through which every verb writes: whole or not at all, never over an input, bound by a manifest.

A folder of results is made beside its place and swapped in by one rename. Its `manifest.json` holds the hashes of what was
read and of what was written; `Reading` refuses a file that is not the one its manifest holds. Files that people fill in or
edit (a plan's tables, TOML) are listed there and not bound. A folder without a manifest is read as it is.
"""

from symfive.outputs._folder import output_file, output_folder, write_bytes, write_json, write_parts, write_text
from symfive.outputs._manifest import MANIFEST, Reading, by_command, own_data

__all__ = [
    "MANIFEST", "Reading", "by_command", "output_file", "output_folder", "own_data", "write_bytes", "write_json",
    "write_parts", "write_text",
]  # fmt: skip
