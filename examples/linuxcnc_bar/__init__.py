"""A circular test on LinuxCNC: plan, control, ball bar behind servo loops with play and friction, export, import, diagnosis."""
