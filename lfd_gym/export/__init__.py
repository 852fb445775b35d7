"""Demonstrations as data sets of other libraries: `lfd-gym export`. To add a format is one file and one row here."""

from typing import NamedTuple


class Format(NamedTuple):
    """A format that demonstrations are exported to."""

    write: str
    """Function from demonstrations, the folder of data sets and a name to the data set's own folder."""
    name: str
    """Name of a data set if none is given."""
    read: str
    """How it is read."""


FORMATS: dict[str, Format] = {
    "minari": Format("lfd_gym.export.minari:to_minari", "{task}/{file}-v0", "minari.load_dataset('{name}')"),
    "lerobot": Format(
        "lfd_gym.export.lerobot:to_lerobot", "{task}/{file}", "LeRobotDataset('{name}', root='{folder}')"
    ),
}
