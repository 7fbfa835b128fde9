"""Definitions of the messages in a ROS 2 bag: its own ones, or those of the standard types.

A bag has the definitions since ROS 2 Iron. For an older one, the library `rosbags` has those of the standard types.
"""

from collections.abc import Mapping

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.formats.extras import optional_module
from osl_analysis.formats.messages.ros2_schema import parse_schema

CONVERT = (
    "convert it with `ros2 bag convert` to MCAP where the type is installed, or record it with ROS 2 Iron or later"
)


class NoDefinitionError(OslAnalysisError):
    """The message says why, and what to do."""


def definition_of(kind: str, own: Mapping[str, tuple[str, str]], distribution: str) -> bytes:
    """The definition of messages of type `kind` (`package/msg/Name`) in ros2msg.

    own: encoding and text of the definitions in the bag, by type.
    distribution: of ROS, which recorded the bag; empty if that is not known.

    Raises
    ------
    NoDefinitionError
        There is none that can be read, or the type is not the same in all distributions of ROS 2.
    """
    encoding, text = own.get(kind, ("", ""))
    if encoding == "ros2msg" and text.strip():
        return text.encode()
    if encoding == "ros2idl" and text.strip():
        raise NoDefinitionError(f"type '{kind}' is defined in IDL, which is not read; {CONVERT}")
    try:
        found = standard_definitions(kind)
    except InputError as error:
        raise NoDefinitionError(f"the bag has no definition of type '{kind}': {error}") from error
    if distribution and f"ROS2_{distribution.upper()}" in found:
        return found[f"ROS2_{distribution.upper()}"].encode()
    layouts = {repr(parse_schema(kind, one)) for one in found.values()}
    if not found:
        raise NoDefinitionError(f"the bag has no definition of type '{kind}', which is no standard one; {CONVERT}")
    if len(layouts) > 1:
        raise NoDefinitionError(
            f"the bag has no definition of type '{kind}', which differs between the distributions of ROS 2; {CONVERT}"
        )
    return next(iter(found.values())).encode()


def standard_definitions(kind: str) -> dict[str, str]:
    """The definition of a standard type in each distribution of ROS 2 that has it, by the name of the distribution.

    Raises
    ------
    InputError
        The library `rosbags` is not installed.
    """
    types = optional_module("rosbags.typesys", "ros", "a bag without definitions of its messages")
    found = {}
    for store in types.Stores:
        if store.name.startswith("ROS2_"):
            known = types.get_typestore(store)
            if kind in known.types:
                found[store.name] = str(known.generate_msgdef(kind, ros_version=2)[0])
    return found
