"""Imports point downward only: read from the source, without importing anything."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("lfd_gym", "policies", "scripted_teachers")
PROGRAMS = ("lfd_gym.cli", "lfd_gym.cli_names", "lfd_gym.experiments", "lfd_gym.report")
OPTIONAL = ("torch", "stable_baselines3", "sb3_contrib", "cma", "minari", "ray")
PHYSICS = ("mujoco", "dm_control")


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(source: str, module: str, is_package: bool = False, top_level: bool = False) -> Iterator[str]:
    """Absolute names of everything that the source imports; only outside functions where `top_level`."""
    tree = ast.parse(source)
    inside = {n for f in ast.walk(tree) if isinstance(f, ast.FunctionDef | ast.AsyncFunctionDef) for n in ast.walk(f)}
    for node in ast.walk(tree):
        if top_level and node in inside:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = module.split(".")
            base = base[: len(base) - node.level + is_package] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{origin}.{alias.name}" for alias in node.names)


def imports_of(path: Path, top_level: bool = False) -> list[str]:
    return list(imported(path.read_text(), module_name(path), path.name == "__init__.py", top_level))


def belongs(name: str, owners: tuple[str, ...]) -> bool:
    return any(name == owner or name.startswith(owner + ".") for owner in owners)


def files(package: str) -> list[Path]:
    found = sorted((ROOT / package).rglob("*.py"))
    assert found, f"no source of {package} under {ROOT}"
    return found


def offences(package: str, forbidden: tuple[str, ...], top_level: bool = False) -> list[str]:
    return [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in files(package)
        for name in imports_of(path, top_level)
        if belongs(name, forbidden) and not belongs(module_name(path), PROGRAMS)
    ]


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("policies", ("scripted_teachers", *PHYSICS)),
        ("scripted_teachers", ("policies", *PHYSICS)),
        ("lfd_gym", ("policies", "scripted_teachers")),
    ],
)
def test_packages_do_not_know_each_other(package: str, forbidden: tuple[str, ...]) -> None:
    assert offences(package, forbidden) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_imports_the_programs(package: str) -> None:
    assert offences(package, PROGRAMS) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_optional_packages_are_imported_on_use_only(package: str) -> None:
    optional_parts = ("policies.reinforcement",)
    found = [
        o for o in offences(package, OPTIONAL, top_level=True) if not o.replace("/", ".").startswith(optional_parts)
    ]
    assert found == []


def test_the_reader_of_imports_sees_every_form() -> None:
    source = (
        "import a.b\nfrom c import d\nfrom . import e\nfrom .f import g\nfrom .. import h\ndef k():\n    import m\n"
    )
    assert set(imported(source, "p.q.r")) == {"a.b", "c.d", "p.q.e", "p.q.f.g", "p.h", "m"}
    assert "m" not in set(imported(source, "p.q.r", top_level=True))
    assert "p.q.e" in set(imported(source, "p.q", is_package=True))
