"""A touch probe on headless LinuxCNC: a trunnion table's eight location errors found, set into the pins, and probed again."""
