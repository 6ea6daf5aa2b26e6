"""Every reader of symfive under its name. A new one is one entry of the table at the end."""

from collections.abc import Callable
from pathlib import Path
from unittest import mock

import symfive.campaign._csv as campaign_csv  # blocks are made short
from symfive.campaign import Campaign, Run, read_campaign
from symfive.campaign._csv import (
    lines_of,  # lines block by block
    read_columns,  # one file without its folder
)
from symfive.cli._measure import truth_of  # without a campaign to measure
from symfive.convert import CONVERTERS, convert
from symfive.errors import InputError
from symfive.fleet import DONE, Row, Task, row_of
from symfive.importers import polar_run, read_mtconnect, read_polar
from symfive.machine import Machine, read_machine
from symfive.model import read_model

from . import right, seeds
from .bundle import unpack
from .checks import Fault, Reader, equal, finite

WORDS = Path(__file__).parent / "words"


def alone(name: str) -> Callable[[bytes, Path], None]:
    """The whole input is one file of that name."""
    return lambda data, folder: (folder / name).write_bytes(data) and None


def words(name: str) -> tuple[str, ...]:
    """What mutations of a format may put in: the lines of a file."""
    return tuple((WORDS / f"{name}.txt").read_text(encoding="utf-8").splitlines())


# ---- campaigns, plans, and what --given names: one reader for all three


def read_bundle(folder: Path) -> Campaign:
    """The campaign of a folder, its runs read whole and, if they are, once more in blocks."""
    campaign = read_campaign(folder)
    for run in campaign.runs:
        in_blocks(folder / run.file, 64)
    return campaign


def in_blocks(path: Path, block: int) -> None:
    """A file is read in short blocks as it is read whole. Lines longer than a block may be refused."""
    whole = [line for _, lines in lines_of(path) for line in lines]
    try:
        parts = [line for _, lines in lines_of(path, block) for line in lines]
    except InputError as error:
        if "bytes" in str(error):
            return
        raise
    equal(whole, parts, path.name)


# ---- a recording: the CSV of one run


def read_recording(folder: Path) -> Run:
    """A dynamic ball-bar run of a three-axis machine, in one block and then in blocks of 40 bytes: both the same."""
    path = folder / "run.csv"
    machine = right.made("three-axis")

    def read() -> Run:
        time, commands, readings, _ = read_columns(path, machine, ("dL_um",), dynamic=True)
        return Run(
            id="run", instrument=("ball_bar",), sampling="dynamic", time=time, commands=commands, readings=readings
        )

    try:
        whole: Run | InputError = read()
    except InputError as error:
        whole = error
    in_parts: Run | InputError
    with mock.patch.object(campaign_csv, "lines_of", lambda path: lines_of(path, 40)):
        try:
            in_parts = read()
        except InputError as error:
            in_parts = error
    if isinstance(whole, InputError):
        if not isinstance(in_parts, InputError):
            raise Fault(f"refused whole and read in blocks: {whole}")
        raise whole
    if isinstance(in_parts, Run):
        equal(whole, in_parts, "run")
    elif "bytes" not in str(in_parts) and "pauses" not in str(in_parts):  # a rate is that of the first block
        raise Fault(f"read whole and refused in blocks: {in_parts}")
    return whole


# ---- a fleet's row, read back


def read_row(folder: Path) -> Row:
    """The row of a fleet's campaign from the results that lie there already; without it no identification begins."""
    campaign = seeds.DATA / "campaigns" / "static-none" / "fit"
    task = Task(name="c", folder=campaign, target=folder)
    refused = InputError("it is not complete", path=folder / DONE, remedy="identify it")
    with (
        mock.patch("symfive.fleet._key", lambda *_: "KEY"),
        mock.patch("symfive.fleet.identify", side_effect=refused),
        mock.patch("symfive.fleet.read_campaign", lambda _: mock.Mock(measured=True)),
    ):
        return row_of(task)


# ---- what others write


def read_circle(folder: Path) -> Run:
    """The file in mm, then as a run: 100 mm about a ball on the three-axis machine."""
    path = folder / "circle.txt"
    angle, deviation = read_polar(path, unit="mm")
    finite((angle, deviation), "polar")
    try:
        return polar_run(right.made("three-axis"), angle, deviation, centre=(0.0, 0.0, 50.0), radius=100.0, feed=1000.0)
    except InputError as error:
        raise error.at(path) from None


def read_declared(folder: Path) -> Run:
    """A file whose columns are declared: a number, the deviation in µm, the angle, sorted whichever way the circle went."""
    path = folder / "circle.txt"
    angle, deviation = read_polar(path, columns=("-", "deviation", "angle"), direction="cw")
    finite((angle, deviation), "columns")
    try:
        return polar_run(right.made("three-axis"), angle, deviation, centre=(0.0, 0.0, 50.0), radius=50.0, feed=500.0)
    except InputError as error:
        raise error.at(path) from None


def read_probe(folder: Path) -> Machine:
    """The machine of a probe; where its structure is not told, with a code."""
    path = folder / "probe.xml"
    try:
        return read_mtconnect(path)
    except InputError as error:
        if "--code" in error.remedy:
            return read_mtconnect(path, code="w X' Y' b Z t")
        if "--device" in error.remedy:
            return read_mtconnect(path, device="M1", code="w C' X' b Z t")
        raise


def read_recorded(folder: Path) -> Campaign:
    """The converter is that of the first folder."""
    name = next((name for name in CONVERTERS if (folder / name).is_dir()), None)
    if name is None:
        raise InputError("there is no recording", path=folder, remedy="add one")
    return convert(name, folder)


READERS: dict[str, Reader] = {
    "machine": Reader(
        put=alone("machine.toml"), read=lambda folder: read_machine(folder / "machine.toml"), check=right.machine_is_right,
        seeds=seeds.machines, words=words("machine"), lines=True,
    ),
    "campaign": Reader(
        put=unpack, read=read_bundle, check=right.campaign_is_right, seeds=seeds.campaigns, words=words("campaign"), lines=True,
    ),
    "recording": Reader(
        put=alone("run.csv"), read=read_recording, check=right.recording_is_right, seeds=seeds.recordings,
        words=words("recording"), lines=True,
    ),
    "model": Reader(
        put=alone("model.json"), read=lambda folder: read_model(folder / "model.json"), check=right.model_is_right,
        seeds=seeds.nothing, words=words("json"),
    ),
    "truth": Reader(
        put=alone("truth.json"), read=lambda folder: truth_of(folder / "truth.json"), check=right.truth_is_right,
        seeds=seeds.nothing, words=words("json"),
    ),
    "fleet-row": Reader(
        put=alone(DONE), read=read_row, check=right.row_is_right, seeds=seeds.nothing, words=words("json"),
    ),
    "polar": Reader(
        put=alone("circle.txt"), read=read_circle, check=right.circle_is_right, seeds=seeds.circles, words=words("polar"),
    ),
    "columns": Reader(
        put=alone("circle.txt"), read=read_declared, check=right.circle_is_right, seeds=seeds.declared, words=words("polar"),
    ),
    "mtconnect": Reader(
        put=alone("probe.xml"), read=read_probe, check=right.machine_is_right, seeds=seeds.probes, words=words("xml"),
    ),
    "convert": Reader(
        put=unpack, read=read_recorded, check=right.campaign_is_right, seeds=seeds.recorded, words=words("recording"),
    ),
}  # fmt: skip
