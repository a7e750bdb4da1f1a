"""What the site takes from the program and the repository while ``make site`` builds it.

A hook of MkDocs (``mkdocs.yml``). It adds the reference that is not worth committing because it
follows from the program, the pictures that ``fluidact-fit demo`` has drawn, and whatever of the
repository a page links to, so that the site needs no network and no other place.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import fluidact_fit as ff
from docs_tables import ROOT, table
from fluidact_fit.families import family_title
from fluidact_fit_cli.program import program

DOCS = ROOT / "docs"
_REPOSITORY = "repository/"  # where files from outside docs stand in the site
_LINK = re.compile(r"(?<=\]\()([^)#\s]+)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of families and of evidence where the navigation names their folder."""
    config.nav = list(_with_folders(config.nav or []))
    return config


def _with_folders(entries: Iterable[object]) -> Iterator[object]:
    """Replace ``name/*`` by the pages of that folder."""
    for entry in entries:
        if isinstance(entry, dict):
            yield {
                title: [*_with_folders(value)] if isinstance(value, list) else value
                for title, value in entry.items()
            }
        elif entry == "families/*":
            yield from (f"families/{name}.md" for name in ff.family_names())
        elif isinstance(entry, str) and entry.endswith("/*"):
            pages = sorted((DOCS / entry[:-2]).glob("*.md"))
            yield from (p.relative_to(DOCS).as_posix() for p in pages if p.stem != "index")
        else:
            yield entry


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add pictures, and files of the repository that pages link to."""
    for picture in sorted((ROOT / config.extra["pictures"]).glob("*.png")):
        files.append(File.generated(config, f"gallery/{picture.name}", abs_src_path=str(picture)))
    for path, text in linked_files().items():
        content = path.read_bytes() if text is None else text
        files.append(File.generated(config, _uri(path), content=content))
    return files


def linked_files() -> dict[Path, str | None]:
    """Files outside ``docs`` that pages link to, and that those link to in turn.

    Returns
    -------
    dict
        The text of every page, ``None`` for a file that is taken as it is. A folder without a
        README has a page that lists its files.
    """
    named = [ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]  # in the navigation
    linked: dict[Path, str | None] = {path: _text(path) for path in named}
    waiting = [*sorted(DOCS.rglob("*.md")), *named]
    while waiting:
        page = waiting.pop()
        for link in _LINK.findall(_text(page)):
            path = _target(page, link)
            if path is None or DOCS in path.parents or path in linked:
                continue
            linked[path] = _text(path) if path.suffix == ".md" else None
            waiting += [path] if path.suffix == ".md" else []
    return linked


def _target(page: Path, link: str) -> Path | None:
    """What a link leads to in the repository: a file, or the page of a folder."""
    path = Path(os.path.normpath(page.parent / link))
    if path.is_dir():
        readme = path / "README.md"
        return readme if readme.is_file() else path / "index.md"
    return path if path.is_file() else None


def _text(page: Path) -> str:
    if page.is_file():
        return page.read_text(encoding="utf-8")
    names = sorted(path.name for path in page.parent.iterdir() if path.is_file())
    return "\n".join([f"# {page.parent.name}", "", *(f"- [{name}]({name})" for name in names)])


def _uri(path: Path) -> str:
    """Place in the site of a file of the repository."""
    if DOCS in path.parents:
        return path.relative_to(DOCS).as_posix()
    return _REPOSITORY + path.relative_to(ROOT).as_posix()


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links out of ``docs`` to their place in the site; give families their picture."""
    uri = page.file.src_uri
    if uri in GENERATED:
        markdown = "\n\n".join([markdown, *GENERATED[uri]()])
    if uri.startswith("families/") and (name := Path(uri).stem) in ff.family_names():
        markdown = f"{markdown}\n\n{_picture(name, '../gallery/')}\n"
    source = ROOT / uri[len(_REPOSITORY) :] if uri.startswith(_REPOSITORY) else DOCS / uri

    def moved(found: re.Match[str]) -> str:
        path = _target(source, found[1])
        if path is None:
            return found[1]
        return posixpath.relpath(_uri(path), posixpath.dirname(uri))

    return _LINK.sub(moved, markdown)


def _picture(name: str, folder: str) -> str:
    what = f"Measured and simulated output of the {name} dataset, and the residual"
    return f"![{what}]({folder}{name}.png)"


# ------------------------------------------------- what is added to pages that say so little


def gallery() -> Iterator[str]:
    """The fit of every dataset."""
    for name in ff.family_names():
        yield f"## {name}"
        yield f"{family_title(name)}: [its page](families/{name}.md)."
        yield _picture(name, "gallery/")


def command_line() -> Iterator[str]:
    """Every command with its arguments and options, those of all fits once."""
    context = click.Context(program, info_name="fluidact-fit")
    commands = {n: program.get_command(context, n) for n in program.list_commands(context)}
    fits = [command for n in ff.family_names() if (command := commands.pop(n))]
    common = set.intersection(*({p.name for p in command.params} for command in fits))
    yield "## Every fit"
    yield "```text\nfluidact-fit FAMILY LOG... [OPTIONS]\n```"
    for part in _options(p for p in fits[0].params if p.name in common):
        yield part.replace(f"{ff.family_names()[0]}.yaml", "FAMILY.yaml")
    for name, command in commands.items():
        if command is not None:
            yield f"## {name}"
            yield from _command(click.Context(command, context, name), command)


def _command(context: click.Context, command: click.Command) -> Iterator[str]:
    formatter = click.HelpFormatter(width=76)
    command.format_usage(context, formatter)
    command.format_help_text(context, formatter)
    yield f"```text\n{formatter.getvalue().rstrip()}\n```"
    yield from _options(command.params)


def _options(params: Iterable[click.Parameter]) -> Iterator[str]:
    """One table of options per heading of the help."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for param in params:
        if isinstance(param, click.Option):
            rows = groups.setdefault(getattr(param, "group", "Options"), [])
            names = ", ".join(f"`{name}`" for name in (*param.opts, *param.secondary_opts))
            value = f" `{param.metavar}`" if param.metavar else ""
            rows.append((names + value, " ".join((param.help or "").split())))
    for title, rows in groups.items():
        yield f"**{title}**"
        yield table(("option", "what"), rows)


def python() -> Iterator[str]:
    """Every public name of the package, by kind; mkdocstrings writes what it is."""
    kinds: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors and warnings": []}
    for name in ff.__all__:
        item = getattr(ff, name)
        if isinstance(item, type):
            raised = issubclass(item, Exception)
            kinds["Errors and warnings" if raised else "Classes"].append(name)
        elif callable(item):
            kinds["Functions"].append(name)
    for kind, names in kinds.items():
        yield f"## {kind}"
        yield from (f"::: fluidact_fit.{name}" for name in names)


GENERATED: dict[str, Callable[[], Iterator[str]]] = {
    "gallery.md": gallery,
    "reference/command-line.md": command_line,
    "reference/python.md": python,
}
