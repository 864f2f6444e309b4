"""Logs as JSON: one line an event, with ids by which a frame can be followed through all processes of its session."""

import json
from pathlib import Path
from typing import Any

import pytest

from support.programs.programs import Person

SERVERS = ("--workers", "2", "--threads", "2")


@pytest.fixture
def person(tmp_path: Path) -> Person:
    person = Person(tmp_path)
    assert person.runs("phantom", "head", "--size", "24x32x28", "-o", "head.nrrd").returncode == 0
    return person


def events(stderr: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stderr.splitlines() if line.startswith("{")]


def test_a_frame_is_followed_by_its_id_through_all_processes(person: Person) -> None:
    done = person.runs("--log-format", "json", "render", "head.nrrd", "-o", "a.png", *SERVERS)
    assert done.returncode == 0, done.stderr
    told = events(done.stderr)
    assert len({event["session"] for event in told if "session" in event}) == 1
    of_frame = {(event["program"], event["event"]) for event in told if event.get("frame") == 1}
    assert of_frame >= {
        ("volsplat", "frame_asked"),
        ("mapshade-server", "frame_begun"),
        ("mapshade-server", "frame_mapped"),
        ("splat-server", "frame_begun"),
        ("splat-server", "frame_finished"),
        ("volsplat", "frame_finished"),
    }
    assert len({event["process"] for event in told}) == 4
    assert all({"time", "level", "event", "message", "program", "process"} <= event.keys() for event in told)


def test_an_error_is_an_event_as_well(person: Person) -> None:
    done = person.runs("--log-format", "json", "render", "none.nrrd", "-o", "a.png")
    (ended,) = events(done.stderr)
    assert (done.returncode, ended["level"], ended["event"]) == (2, "error", "program_ended")
    assert "none.nrrd" in ended["message"]


def test_for_a_person_nothing_is_said_but_words(person: Person) -> None:
    done = person.runs("render", "none.nrrd", "-o", "a.png")
    assert done.stderr.startswith("volsplat: none.nrrd")
    done = person.runs("-v", "render", "head.nrrd", "-o", "a.png", *SERVERS)
    assert "volsplat: frame 1, step F, is asked for\n" in done.stderr
    assert events(done.stderr) == []


def test_a_name_cannot_make_a_line_of_its_own(person: Person) -> None:
    done = person.runs("--log-format", "json", "render", 'x"\n{"event": "made_up"}', "-o", "a.png")
    assert [event["event"] for event in events(done.stderr)] == ["program_ended"]
