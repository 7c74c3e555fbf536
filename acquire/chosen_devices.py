"""Virtual devices that a command's options choose."""

from __future__ import annotations

from typing import Any

from acquire.console.virtual_options import refuse_other_kind, refuse_truth_of_ours
from acquire.virtual.device_kinds import DeviceKinds
from acquire.virtual.devices import DeviceOptions
from acquire.virtual.gige_sockets import free_address
from acquire.virtual.given_contents import parse_contents
from acquire.virtual.packaging import Packaging, PrintKind


def device_options(options: dict[str, Any]) -> DeviceOptions:
    """Choice of a virtual rig; its options are removed from those of the command.

    Args:
        options: options of the command by name.

    Raises:
        ConfigError: options that do not go together, or contents that cannot be read.
    """
    names = ("object_name", "seed", "address", "truth", "contents", "friction")
    given = {name: options.pop(name) for name in names}
    kinds = {name: options.pop(name) for name in ("camera", "make", "striker", "servo")}
    surface = Packaging(PrintKind(options.pop("print_kind")), given["seed"], options.pop("gloss"))
    refuse_truth_of_ours(given["object_name"], given["truth"])
    refuse_other_kind(**kinds)
    given["truth_path"], given["address"] = given.pop("truth"), given["address"] or free_address()
    if given["contents"] is not None:
        given["contents"] = parse_contents(given["contents"])
    return DeviceOptions(**given, kinds=DeviceKinds(**kinds), packaging=surface, tags=options.pop("tags"))
