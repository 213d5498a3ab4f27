"""The bench file of served instruments, which names their drivers and ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from labapp.bench.virtual_bench.instruments import ServedInstrument
from labapp.files.bench_file import BenchFile
from labapp.files.plan_folder import as_toml

_HEAD = """\
# A virtual bench behind its wires: real drivers, and instruments that are simulated.
# Its ports are there while `labapp virtual-bench serve` runs.
"""


def bench_text(
    bench: BenchFile, served: Mapping[str, ServedInstrument], targets: Sequence[str]
) -> str:
    """Return the bench file of served instruments as TOML.

    Devices that aren't served keep their tables from `bench`.
    """
    data = bench.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    devices = data.pop("devices")
    data["name"] = f"{bench.name}, behind its wires"
    text = _HEAD
    for role in {**devices, **served}:
        if role == "targets":
            table = _device_table("manual-targets", {"names": list(targets)})
        elif one := served.get(role):
            table = _device_table(one.driver, one.options)
        else:
            text += f"# The {role} isn't served: it is the one that the bench file had.\n"
            table = devices[role]
        data[f"devices.{role}"] = table
    return text + as_toml(data)


def _device_table(driver: str, options: dict[str, Any]) -> dict[str, Any]:
    return {"driver": driver, "options": options, "simulated": True}
