"""symfive: one symbolic model of five-axis machine tools, for identification, test design, diagnosis and code."""

__version__ = "0.1.0"
