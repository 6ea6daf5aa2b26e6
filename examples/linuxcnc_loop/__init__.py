"""The closed loop on a real control: `python -m examples.linuxcnc_loop -o RESULTS [--preset NAME ...]`.

A machine of the independent plant is measured through LinuxCNC, identified by symfive, and run again through LinuxCNC with
the identified errors in the kinematics. What makes the truth (`truth`) knows nothing of symfive's model.
"""
