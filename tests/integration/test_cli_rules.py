"""`conflictdb admin rules`, and `conflicts --class`."""

from commands import STRAIT, Run

ON = ("admin", "rules", "--scene", "strait")


def test_rules_are_entered_listed_and_removed(run: Run) -> None:
    assert run("load", STRAIT).code == 0
    assert run(*ON).out.startswith("no rules")
    entered = run(*ON, "ferry", "area", "--set", "separation_m=500,yields=a")
    assert (entered.code, entered.out) == (0, "strait: rule of ferry with area entered\n")
    assert run(*ON, "escort", "any", "--set", "allowed=true").code == 0
    assert [line.split() for line in run(*ON).out.splitlines()[1:]] == [
        ["escort", "any", "yes"],
        ["ferry", "area", "500", "ferry"],
    ]
    assert run(*ON, "area", "ferry", "--remove").out == "strait: rule of area with ferry removed\n"
    assert "wide: is not known" in run(*ON, "a", "b", "--set", "wide=5").err
    assert "two sides go with" in run(*ON, "a", "b").err
    assert run("conflicts", "--class", "ferry").out == "no conflict is known\n"
