"""``--help`` of a command: its examples, groups and options, as its file in conf/ and the folders beside it say."""

from __future__ import annotations

import re
import textwrap

from .configs import Configs, called

WIDTH = 110


def usage(configs: Configs) -> str:
    """Examples, groups with the options that there are, single options with their defaults: one screen."""
    name = configs.name
    lines = (configs.folder / f"{name}.yaml").read_text(encoding="utf-8").split("\nhydra:")[0].splitlines()
    examples = [line.removeprefix("# ") for line in lines if line.startswith("# python")]
    if not called(name).startswith("python"):
        examples = [re.sub(r"^python (\w+)\.py", r"frictionpinn \1", text) for text in examples]
    groups = [found.groups() for line in lines if (found := re.match(r"  - (\w+): (\w+)", line))]
    shown = [f"  {f'{key}={value}':<26}{', '.join(configs.options(key))}" for key, value in groups]
    own = lines[max(k for k, line in enumerate(lines) if line.startswith("  - ")) + 1 :]
    return "\n".join([
        f"{called(name)} key=value ...",
        "\nexamples",
        *(f"  {text}" for text in examples),
        "\ngroups: each value is a file" + (" in conf/ or your --config-dir" if configs.own is None else ""),
        *(wrapped for text in shown for wrapped in _wrapped(text, 28)),
        "\noptions: key=value, of a section section.key=value",
        *(wrapped for line in own if line.strip() for wrapped in _option(line)),
        "\n-m: a sweep over values with commas; --cfg job: print the configuration; --config-dir DIR: your own files",
    ])  # fmt: skip


def _option(line: str) -> list[str]:
    """An option with its comment; lists and comments between the options stay as they are."""
    return [line] if line.strip()[0] in "#-" or "#" not in line else _wrapped(line, line.index("#"), "# ")


def _wrapped(text: str, indent: int, mark: str = "") -> list[str]:
    """Lines of at most ``WIDTH``, the further ones indented: a comment goes on as one."""
    return textwrap.wrap(text, WIDTH, subsequent_indent=" " * indent + mark, break_on_hyphens=False)
