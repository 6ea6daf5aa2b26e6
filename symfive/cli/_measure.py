"""Before the measurement: assess and simulate a plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from symfive.cli import _common as cli
from symfive.errors import InputError, inside
from symfive.files import shown
from symfive.outputs import output_folder, write_json

if TYPE_CHECKING:
    from symfive.effects import Effect


@cli.app.command(epilog="Example: symfive assess designs/plans/r-test-grid")
@cli.campaign_path
@click.option("--given", type=cli.PATH, help="A campaign that was measured before on this machine.")
@cli.as_json
@cli.quiet
def assess(campaign: Path, given: Path | None, as_json: bool, quiet: bool) -> None:
    """Assess a plan or campaign. Expected 1σ of each error, and errors that it cannot separate."""
    from symfive.design import assess as assess_campaign

    earlier = None if given is None else cli.read(given, quiet)
    result = assess_campaign(cli.read(campaign, quiet), given=earlier)
    cli.tell(result.to_data(), str(result), as_json)


def truth_of(path: Path | None) -> tuple[dict[str, float], tuple[Effect, ...]]:
    """Values and effects of a truth file: `truth.json`, `model.json` or `identification.json`."""
    from symfive.model import effects_from_data, read_json
    from symfive.validation import is_number

    if path is None:
        return {}, ()
    data = read_json(path)
    parameters = data.get("parameters") if isinstance(data, dict) else None
    if not isinstance(parameters, dict):
        raise InputError("the truth has no parameters", path=path, remedy='write { "parameters": { "EX0C": 12.0 } }')
    values = {}
    for name, entry in parameters.items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        if not is_number(value):
            raise InputError(f"the value of {shown(name)} is not a finite number", path=path, remedy="write a number")
        values[str(name)] = float(value)
    return values, effects_from_data(data.get("effects", []), path)


@cli.app.command(epilog="Example: symfive simulate plan/ -o measured/ --seed 7")
@cli.campaign_path
@cli.output_path
@click.option("--truth", type=cli.PATH, help="True parameter values (JSON); the others are drawn.")
@click.option("--seed", type=cli.SEED, default=0, help="Seed of machine and noise.")
@cli.overwrite
@cli.quiet
def simulate(campaign: Path, output: Path, truth: Path | None, seed: int, overwrite: bool, quiet: bool) -> None:
    """Simulate the readings of a plan. The campaign with readings, and truth.json."""
    from symfive.campaign import write_campaign_files
    from symfive.simulate import simulate as simulate_plan

    with output_folder(output, overwrite=overwrite) as folder:
        values, effects = truth_of(truth)
        plan = cli.read(campaign, quiet)
        with inside(path=truth):
            result = simulate_plan(plan, truth=values, effects=effects, seed=seed)
        write_campaign_files(result.campaign, folder)
        write_json(folder / "truth.json", result.to_data())
    cli.written(result.campaign, output, quiet)
