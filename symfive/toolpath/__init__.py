"""The tool path of a user's part: from an NC program or a table of poses to places on it, each with its line."""

from symfive.toolpath._path import ToolPath
from symfive.toolpath._read import read_tool_path

__all__ = ["ToolPath", "read_tool_path"]
