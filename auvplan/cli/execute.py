"""The command that executes a mission on a vehicle."""

import json
import math
import sys
from contextlib import suppress
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from auvplan.cli import shared
from auvplan.errors import AuvplanError, ScenarioError
from auvplan.runtime.files import EXECUTION, OutputError, output_folder
from auvplan.runtime.formatting import counted, figure

if TYPE_CHECKING:
    from auvplan.link import ExecutionRecord, Limits
    from auvplan.link.record import Event

#: s between now and the scenario's departure that are worth a warning: its forecast is of another time.
_APART = 600.0


def execute(
    scenario: shared.ScenarioArgument = "whitsunday",
    link: Annotated[
        str,
        typer.Option(
            help="The vehicle: sim, mavlink:ADDRESS as pymavlink takes it, such as "
            "mavlink:udpin:0.0.0.0:14550, imc:HOST:PORT or imc:tcp:HOST:PORT."
        ),
    ] = "sim",
    out: shared.OutOption = Path("out/execute"),
    seed: shared.SeedOption = 0,
    scale: Annotated[
        float | None,
        typer.Option(
            help="Seconds of the vehicle's time in one of the clock's, for simulated vehicles. "
            "1 if absent; for sim as fast as it goes."
        ),
    ] = None,
    link_loss: Annotated[
        Literal["continue", "surface"] | None,
        typer.Option(
            help="What ArduSub is set to do when it hears nobody: continue or surface. If absent, as it is."
        ),
    ] = None,
    speed: Annotated[
        shared.SpeedHeld | None,
        typer.Option(
            help="What the vehicle holds its speed over: ground, for which it is given what each line is "
            "planned to make, or water, such as one without a bottom lock. If absent, ground, but for sim."
        ),
    ] = None,
    notices: Annotated[
        Path | None,
        typer.Option(help="File of JSON lines, read as it grows, that report obstacles and currents."),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Another limit, such as silence=30. See the page."),
    ] = None,
    changes: shared.SetOption = None,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Plan a mission and execute it on a vehicle: upload, follow, re-plan the rest, end safely."""
    quiet = quiet or as_json
    from auvplan.link.opening import SIMULATOR, check_address

    limits = _limits(limit or [])
    loss = link_loss or ""
    check_address(link, loss)
    if speed and link == SIMULATOR:
        raise AuvplanError("--speed: is for vehicles: the simulator's holds its speed through the water")
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise AuvplanError(f"--scale: must be positive, got {scale:g}")
    output_folder(out)
    if link != SIMULATOR:
        _check_ended(out)
    with shared.naming(scenario):
        settings, folder = shared.load(scenario, settings=changes)
        from auvplan.runtime.compiled import PLANS, preload

        preload(PLANS, settings.fingerprint)
        from auvplan.executive import load_area_at
        from auvplan.link import execute, open_link
        from auvplan.link.notices import AllNotices, NoticeFile, Notices
        from auvplan.link.rolling import RollingPlan
        from auvplan.link.simulated import SimulatedVehicle

        if link != SIMULATOR and settings.site is None:
            raise ScenarioError("site: is missing: a vehicle is given longitude and latitude")
        area = load_area_at(settings, [0.0], folder)
        plan = RollingPlan(settings, seed, folder, area)
        heard: list[Notices] = [] if notices is None else [NoticeFile(notices, plan.site)]
        if link == SIMULATOR:
            vehicle = SimulatedVehicle(settings, seed, folder, area, scale)
            heard.append(vehicle)
        else:
            vehicle = open_link(link, plan.site, limits, scale or 1.0, loss, speed != "water")
    if not quiet:
        shared.say_notes(area.notes)
        epoch = None if link == SIMULATOR or scale is not None else plan.site.epoch
        if epoch is not None and abs((datetime.now(UTC) - epoch).total_seconds()) > _APART:
            from auvplan.site import at_time

            departs = at_time(0.0, epoch)
            shared.say(f"note: the plan is for a departure at {departs}, and the vehicle leaves now")

    def tell(event: "Event") -> None:
        if not quiet and event.kind != "end":
            shared.say(f"{event.time:9.0f} s  {event.text}")
            sys.stdout.flush()

    def keep(record: "ExecutionRecord") -> None:
        with suppress(OutputError):  # a vehicle under way does not wait for a full disk
            record.save(out)

    record = execute(plan, vehicle, limits=limits, notices=AllNotices(*heard), tell=tell, keep=keep)
    file = out / EXECUTION
    kept = not record.uploads and file.exists()  # the vehicle was not started: what was before stays
    file = file if kept else record.save(out)
    if as_json:
        shared.print_json(record.summary())
    elif not quiet:
        shared.say(
            f"{record.reason}; {record.safe}; {record.t_mission:.0f} s of {record.t_available:.0f} s, "
            f"{counted(len(record.tasks), 'task')}, total priority {figure(record.total_priority)}"
        )
        shared.say(f"record of an earlier mission in {file}" if kept else f"record in {file}")
    if not record.success:
        shared.print_error(f"mission failed: {record.reason}; {record.safe}")
        raise typer.Exit(1)


def _check_ended(out: Path) -> None:
    """Raise AuvplanError where an execution is under way in a folder, or was broken off."""
    from auvplan.link.record import UNDER_WAY

    file = out / EXECUTION
    try:
        reason = json.loads(file.read_text(encoding="utf-8"))["reason"]
    except (OSError, ValueError, TypeError, KeyError):
        return
    if reason == UNDER_WAY:
        raise AuvplanError(
            f"{file}: its mission did not end: see to the vehicle, which may be under way, "
            "and remove the file or give another --out"
        )


def _limits(texts: list[str]) -> "Limits":
    """Return limits with those of `--limit` in place of their own; raise AuvplanError where one is none."""
    from auvplan.link import Limits

    kinds = {field.name: type(field.default) for field in fields(Limits)}
    given = {}
    for text in texts:
        name, mark, value = text.partition("=")
        if not mark or name not in kinds:
            raise AuvplanError(f"--limit {text!r}: give it as NAME=VALUE with a name of {', '.join(kinds)}")
        try:
            given[name] = kinds[name](value)
        except ValueError:
            kind = "whole number" if kinds[name] is int else "number"
            raise AuvplanError(f"--limit {text!r}: {value!r} is no {kind}") from None
    return replace(Limits(), **given)
