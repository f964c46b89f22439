"""Every finding is described for one and for several."""

from shapes import icosphere

from cascadenorm.api.inspection import FINDINGS, Found, Inspection, inspect
from cascadenorm.cli.tables import counted

BALL = icosphere(2)


def test_every_finding_can_be_said_of_one_and_of_several():
    found = inspect(BALL)
    names = {name for name in Inspection.__dataclass_fields__ if isinstance(getattr(found, name), Found)}
    assert set(FINDINGS) == names
    for one, several in FINDINGS.values():
        assert one != several and counted(1, one, several) == f"1 {one}" and counted(0, one, several) == f"0 {several}"
