"""The import table of the design: who may import whom, and that no import circle exists."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

NUMERICS = {"service.recording"}
ALLOWED: dict[str, set[str]] = {
    "drivers": set(),
    "drivers.sim": {"drivers"},
    "service.recording": set(),
    "service.dynamics": NUMERICS,
    "service.backlash": NUMERICS | {"service.dynamics"},
    "service.monitoring": NUMERICS | {"service.backlash"},
    "service.identification": NUMERICS | {"service.dynamics", "service.backlash"},
    "service.report": NUMERICS,
    "service.config": {"service.dynamics", "drivers"},
    "service.captures": NUMERICS | {"service.backlash"},
    "service.store": NUMERICS | {"service.backlash", "service.monitoring", "migrations"},
    "service.motion": NUMERICS | {"drivers", "service.config", "service.dynamics"},
    "service.runs": {
        "service.motion", "service.store", "service.captures", "service.config", "service.recording",
        "service.backlash", "service.monitoring", "service.identification", "service.dynamics",
        "service.report",
    },
    "service.api": {
        "service.runs", "service.store", "service.config", "service.backlash", "service.monitoring",
        "service.report",
    },
    "service.app": {
        "service.api", "service.runs", "service.motion", "service.store", "service.captures", "service.config",
        "service.backlash", "service.monitoring", "service.report", "service.recording",
    },
    "service.explaining": {"service.captures", "service.identification", "service.report"},
    "service.analyze": {"service.backlash", "service.captures"},
    "service.planning": {"service.backlash", "service.config"},
    "service.remote": set(),
    "service.cli": set(),
    "service.demo": {
        "drivers.sim", "drivers", "service.app", "service.dynamics", "service.config", "service.runs",
        "service.motion", "service.store", "service.backlash", "service.recording",
    },
}  # fmt: skip
"""Each room and what it may import of the house; a room may always import itself. service.cli imports all."""

FORBIDDEN_IN_NUMERICS = {
    "time",
    "threading",
    "sqlalchemy",
    "pydantic",
    "can",
    "canopen",
    "fastapi",
    "asyncio",
}
PURE = (
    "service.recording",
    "service.dynamics",
    "service.backlash",
    "service.monitoring",
    "service.identification",
    "service.report",
)


def modules() -> dict[str, Path]:
    files = [path for top in ("service", "drivers") for path in (ROOT / top).rglob("*.py")]
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in files
    }


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def room_of(module: str) -> str:
    rooms = [room for room in ALLOWED if module == room or module.startswith(room + ".")]
    return max(rooms, key=len, default=module)


@pytest.mark.parametrize(
    "module",
    sorted(m for m in modules() if m not in ("service", "service.__main__") and room_of(m) != "service.cli"),
)
def test_imports_only_what_the_table_allows(module: str) -> None:
    room = room_of(module)
    for name in imports(modules()[module]):
        if name.split(".")[0] in ("service", "drivers", "migrations", "tests"):
            target = room_of(name)
            assert target in ALLOWED[room] | {room}, f"{module} imports {name}"


@pytest.mark.parametrize("module", sorted(name for name in modules() if name.startswith(PURE)))
def test_numerics_are_pure(module: str) -> None:
    found = {name.split(".")[0] for name in imports(modules()[module])}
    assert not found & FORBIDDEN_IN_NUMERICS


def test_there_is_no_import_circle() -> None:
    known = modules()
    graph = {}
    for module, path in known.items():
        named = {name if name in known else name.rpartition(".")[0] for name in imports(path)}
        graph[module] = (named & set(known)) - {module}
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join([*trail, module])
        if module not in done:
            for target in graph[module]:
                visit(target, (*trail, module))
            done.add(module)

    for module in graph:
        visit(module, ())
