# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pages say what the code says: links, paths, commands, options, terms, and the graph of the packages."""

import argparse
import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
PACKAGES = {path.parent.name for path in SOURCES.glob("*/package.xml")}
VERBS = {path.stem.replace("_", "-") for path in (SOURCES / "magat_cli/magat_cli/verb").glob("[a-z]*.py")}
#: Where paths in code spans begin, those of packages apart.
FOLDERS = ("ros2_ws/src/", "tests/", "tools/", "docs/", ".ci/")

BLOCK = re.compile(r"^```.*?\n(.*?)^```", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")

each_page = pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])


def blocks(page: Path) -> list[str]:
    """The code blocks of a page, continued lines joined."""
    return [block.replace("\\\n", " ") for block in BLOCK.findall(page.read_text())]


def prose(page: Path) -> str:
    """A page without its code blocks."""
    return BLOCK.sub("", page.read_text())


def spans(page: Path) -> list[str]:
    """The code spans of a page."""
    return [re.sub(r"\s+", " ", span) for span in SPAN.findall(prose(page))]


# --- Links and paths ---


def anchors(page: Path) -> set[str]:
    """What links may name after a page's ``#``: its headings, as GitHub and site generators write them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{page.name} links to {link}"
        assert not anchor or anchor in anchors(target), f"{page.name} links to {link}"
        # A site of the pages has nothing else.
        assert page.parent != DOCS or target.is_relative_to(DOCS), f"{page.name} links to {link}, outside of docs/"


def exists(name: str) -> bool:
    """Whether a path is there: of the repository, or of a package, within its module folder or not."""
    package, _, rest = name.partition("/")
    places = [ROOT / name]
    if package in PACKAGES:
        places = [SOURCES / package / package / rest, SOURCES / package / rest]
        if package == "magat_interfaces":
            places += [SOURCES / package / f"{rest}.{kind}" for kind in ("msg", "srv", "action")]
    return any(place.exists() for place in places)


@each_page
def test_paths_are_there(page: Path) -> None:
    for span in spans(page):
        in_package = "/" in span and span.partition("/")[0] in PACKAGES
        placeholder = re.search(r"NAME|VERB|[^\w./-]", span)
        if (in_package or span.startswith(FOLDERS)) and not placeholder:
            assert exists(span), f"{page.name} names {span}"


# --- Commands ---


def module_path(name: str) -> Path:
    """The file, or the folder, of a module of this workspace."""
    folder = SOURCES / name.partition(".")[0] / name.replace(".", "/")
    return folder if folder.is_dir() else folder.with_suffix(".py")


@each_page
def test_modules_are_there(page: Path) -> None:
    text = "\n".join(blocks(page) + spans(page))
    for run, named in re.findall(r"python -m (magat_[\w.]+)|^(magat_\w+(?:\.\w+)+)$", text, re.MULTILINE):
        name = run or named
        assert module_path(name).exists(), f"{page.name} names {name}"


def executables(package: str) -> set[str]:
    """What ``ros2 run`` finds in a package."""
    setup = SOURCES / package / "setup.py"
    found = {path.name for path in (SOURCES / package / "scripts").glob("*")}
    return found | (set(re.findall(r'"(\w+) = [\w.]+:main"', setup.read_text())) if setup.exists() else set())


@each_page
def test_executables_are_there(page: Path) -> None:
    text = "\n".join(blocks(page) + spans(page))
    pairs = re.findall(r"ros2 run (magat_\w+) (\w+)", text) + re.findall(r"^(magat_\w+) (\w+)$", text, re.MULTILINE)
    for package, executable in pairs:
        assert executable in executables(package), f"{page.name} runs {package} {executable}"


@each_page
def test_make_targets_are_there(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for code in [line for block in blocks(page) for line in block.splitlines()] + spans(page):
        if found := re.match(r"(?:time )?make ([a-z-]+)", code):
            assert found[1] in targets, f"{page.name} names make {found[1]}"


def parser_of(verb: str) -> argparse.ArgumentParser:
    """The options of a verb."""
    parser = argparse.ArgumentParser(prog=f"magat {verb}", exit_on_error=False)
    importlib.import_module(f"magat_cli.verb.{verb.replace('-', '_')}").add_arguments(parser)
    return parser


def commands(code: str) -> Iterator[tuple[str, str]]:
    """Verbs and what follows them, of all ``magat VERB ...`` in a piece of code."""
    for line in code.splitlines():
        command = re.sub(r"(^|\s)#.*", "", line)
        yield from re.findall(r"(?<![\w./-])magat ([a-z][a-z-]*)([^)\n]*)", command)


@each_page
def test_commands_can_be_parsed(page: Path) -> None:
    for block in blocks(page):
        for verb, rest in commands(block):
            assert verb in VERBS, f"{page.name} has magat {verb}"
            try:
                parser_of(verb).parse_args(shlex.split(rest.rstrip('"')))
            except (argparse.ArgumentError, SystemExit, ValueError) as error:
                pytest.fail(f"{page.name} has magat {verb}{rest}: {error}")


@each_page
def test_options_in_sentences_exist(page: Path) -> None:
    for span in spans(page):
        for verb, rest in commands(span):
            assert verb in VERBS, f"{page.name} has magat {verb}"
            unknown = set(re.findall(r"(?<!\S)--[a-z][a-z-]*", rest)) - set(parser_of(verb)._option_string_actions)
            assert not unknown, f"{page.name} has magat {verb}{rest}"


# --- Parameters and launch arguments ---


def table_rows(page: Path, heading: str) -> list[list[str]]:
    """The cells of the rows of the table under a line that begins with ``heading``."""
    lines = page.read_text().split(f"\n{heading}", 1)[1].splitlines()[2:]
    end = next((number for number, line in enumerate(lines) if not line.startswith("|")), len(lines))
    return [[cell.strip().strip("`") for cell in line.split("|")[1:-1]] for line in lines[:end]]


def test_parameters_are_those_of_the_nodes() -> None:
    packages = {"robot": "robot", "simulator": "sim", "expert": "expert", "recorder": "recording"}
    packages |= {"viewer": "viewer", "rviz_bridge": "viewer"}
    documented: set[tuple[str, str]] = set()
    package = ""
    for node, parameter, *_ in table_rows(DOCS / "deployment.md", "| node | parameter |"):
        package = packages[node] if node else package
        documented.add((package, parameter))
    declared = {
        (package, name)
        for package in packages.values()
        for path in (SOURCES / f"magat_{package}" / f"magat_{package}").rglob("*.py")
        for name in re.findall(r'\bdeclare_\w+\(\s*[\w.]+,\s*"(\w+)"', path.read_text())
    }
    assert documented == declared


def test_launch_arguments_are_those_of_the_launch_file() -> None:
    documented = [argument for argument, *_ in table_rows(DOCS / "deployment.md", "| argument | default |")]
    text = (SOURCES / "magat_bringup/launch/team.launch.py").read_text()
    assert documented == re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text)


# --- The glossary ---


def tables() -> list[list[tuple[str, str]]]:
    """The tables of the glossary: terms, and where each is in the code."""
    parts = (DOCS / "glossary.md").read_text().split("\n## ")[1:]
    return [re.findall(r"^\| (.+?) \| .+ \| (.+?) \|$", part, re.MULTILINE)[1:] for part in parts]


@pytest.mark.parametrize(("term", "code"), [row for table in tables() for row in table])
def test_terms_are_in_the_code(term: str, code: str) -> None:
    text = ""
    for name in SPAN.findall(code):
        package, _, rest = name.partition("/")
        path = SOURCES / package / package / rest
        if "/" in name:
            assert exists(name), f"{term}: there is no {name}"
            text += path.read_text() if path.is_file() else ""
        else:
            assert re.search(rf"\b{name}\b", text), f"{term}: {name} is not in {code}"


def test_terms_are_in_order() -> None:
    for table in tables():
        terms = [re.sub(r"[^a-z0-9 ]", "", term.casefold()) for term, _ in table]
        assert len(terms) > 10
        assert terms == sorted(set(terms))


# --- The packages ---


def imports() -> dict[str, set[str]]:
    """Which packages each package imports, in functions, too."""
    found: dict[str, set[str]] = {}
    for package in PACKAGES:
        nodes = [n for f in (SOURCES / package / package).rglob("*.py") for n in ast.walk(ast.parse(f.read_text()))]
        names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        names |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
        found[package] = {name.partition(".")[0] for name in names} & PACKAGES - {package}
    return found


def test_the_graph_of_the_packages_is_the_one_drawn() -> None:
    direct = imports()

    def reached(package: str) -> set[str]:
        return direct[package].union(*(reached(other) for other in direct[package]))

    needed = {
        (package, other)
        for package, others in direct.items()
        for other in others
        if not any(other in reached(third) for third in others)
    }
    drawn = re.findall(r"^ *(magat_\w+) --> (magat_\w+)$", (DOCS / "architecture.md").read_text(), re.MULTILINE)
    assert set(drawn) == needed
