"""An unknown option was said to mean an unlike one. Only nearly the same name is suggested, and one name only."""

import pytest

from aoprecalc.cli import main


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["bake", "a.obj", "--lightmap", "3"], None),
        (["bake", "a.obj", "--max-distanse", "3"], "--max-distance"),
        (["bake", "a.obj", "--samples", "3"], "--directions"),
        (["bake", "a.obj", "-z"], None),
        (["xyz"], None),
        (["bake", "a.obj", "--unwarp", "auto"], "--unwrap"),
        (["bake", "a.obj", "--direction", "9"], "--directions"),
        (["bake", "a.obj", "--outptu", "a.png"], "--output"),
        (["bake", "a.obj", "--meshoutput=a.obj"], "--mesh-output"),
        (["spheres", "a.obj", "--sphere", "9"], "--spheres"),
        (["batch", "a.obj", "-o", "out", "--bake", "--siez 9"], "--size"),
        (["bakee"], "bake"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_suggestion_is_nearly_what_was_written(command, words, hint):
    done = command(*words)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "o such" in done.stderr
    assert done.stderr.count("id you mean") == (hint is not None)
    if hint:
        assert f"(did you mean '{hint}'?)" in done.stderr


def test_every_option_is_near_to_itself_without_a_letter(command):
    """So that no option is beyond reach: one letter less is understood for every long name."""
    for parent in main.commands.values():
        for name in {name for entry in parent.params for name in entry.opts if len(name) > 5 and name.startswith("--")}:
            known = {other for entry in parent.params for other in (*entry.opts, *entry.secondary_opts)}
            if (short := name[:3] + name[4:]) not in known:
                assert "did you mean" in command(parent.name, "x", short).stderr, short
