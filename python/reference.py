"""The texts that `help()`, editors and docs/python-reference.md show are one: those of the installed package at run time.

    python python/reference.py            # writes them into the stub and the page
    python python/reference.py --check    # fails if they are not there

The native part has its texts in python/src, as documentation comments. The stub adds the types, which are edited there.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import isotherm
from isotherm import _isotherm

FOLDER = Path(__file__).resolve().parent
STUB = FOLDER / "python/isotherm/_isotherm.pyi"
PAGE = FOLDER.parent / "docs/python-reference.md"
HEAD = """# Python reference

This page lists every name of the package `isotherm`, as `help()` shows it. [python.md](python.md) shows how the names
work together. `python/reference.py` writes this page.
"""
PARTS = {
    "Calibrate": ("calibrate_turntable", "calibrate_tumble", "calibrate_warm_up", "calibrate_vehicle", "Calibration", "Vehicle"),
    "Verify, analyse, compare": ("verify", "Stability", "lengths", "noise", "regress", "compare", "Comparison", "batch", "Batch"),
    "Tables": ("Table", "Axis", "Polynomial", "export_parameters", "Exported", "import_parameters"),
}


def members(stub: ast.Module) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef]]:
    """The public classes, methods, properties and functions of the stub, with their dotted names."""
    for node in stub.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and getattr(isotherm, node.name, None) is getattr(_isotherm, node.name):
            yield node.name, node
            for inner in node.body if isinstance(node, ast.ClassDef) else ():
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_") and not is_setter(inner):
                    yield f"{node.name}.{inner.name}", inner


def is_setter(node: ast.FunctionDef) -> bool:
    return any(isinstance(decorator, ast.Attribute) for decorator in node.decorator_list)


def text_of(name: str) -> str:
    """The text of a public name at run time."""
    value: object = isotherm
    for part in name.split("."):
        value = inspect.getattr_static(value, part)
    text = value.__doc__
    if not text:
        sys.exit(f"isotherm.{name} has no text: write it in python/src, or in python/python/isotherm")
    return inspect.cleandoc(text)


def with_texts(stub: str) -> str:
    """The stub with the texts of the run time."""
    lines = stub.splitlines()
    for name, node in reversed(list(members(ast.parse(stub)))):
        indent, text = " " * (node.col_offset + 4), text_of(name).splitlines()
        quoted = [f'{indent}"""{text[0]}', *(f"{indent}{line}".rstrip() for line in text[1:])]
        quoted = [*quoted[:-1], quoted[-1] + '"""'] if len(quoted) == 1 else [*quoted, f'{indent}"""']
        first = node.body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            end = first.end_lineno or first.lineno
            is_text = isinstance(first.value.value, str)
            if is_text:
                lines[first.lineno - 1 : end] = quoted
            else:
                # `def name(..) -> ..: ...`
                lines[end - 1] = lines[end - 1].removesuffix(" ...")
                lines[end:end] = quoted
        else:
            lines[first.lineno - 1 - len(getattr(first, "decorator_list", ())) : first.lineno - 1] = [
                *quoted,
                "",
                *lines[first.lineno - 1 - len(getattr(first, "decorator_list", ())) : first.lineno - 1],
            ]
    return "\n".join(lines) + "\n"


def signature(name: str, stub: dict[str, ast.ClassDef | ast.FunctionDef]) -> str:
    """How a name is called, with types: of the native part from the stub."""
    node = stub.get(name)
    if isinstance(node, ast.ClassDef):
        new = [inner for inner in node.body if isinstance(inner, ast.FunctionDef) and inner.name == "__new__"]
        return f"{name}({listed(new[0])})" if new else name
    if isinstance(node, ast.FunctionDef):
        of = ast.unparse(node.returns) if node.returns else "None"
        is_property = any(isinstance(decorator, ast.Name) and decorator.id == "property" for decorator in node.decorator_list)
        return f"{name}: {of}" if is_property else f"{name}({listed(node)}) -> {of}"
    value: object = isotherm
    for part in name.split("."):
        value = inspect.getattr_static(value, part)
    if isinstance(value, property) and value.fget:
        return f"{name}: {inspect.signature(value.fget).return_annotation}"
    if inspect.isfunction(value):
        return name + re.sub(r"\(self(, )?", "(", str(inspect.signature(value))).replace("'", "")
    return name


def listed(node: ast.FunctionDef) -> str:
    """The arguments without `self`."""
    return re.sub(r"^(self|cls)(, )?(/, )?", "", ast.unparse(node.args))


def entry(name: str, stub: dict[str, ast.ClassDef | ast.FunctionDef], level: str) -> str:
    called = "\n".join(textwrap.wrap(signature(name, stub), 110, subsequent_indent="    ", break_long_words=False))
    return f"\n{level} {name}\n\n```text\n{called}\n```\n\n{prose(text_of(name))}\n"


def prose(text: str) -> str:
    """Examples become code; paragraphs have lines of 120 columns."""
    blocks = [f"```python\n{block}\n```" if block.startswith(">>>") else textwrap.fill(block, 120) for block in text.split("\n\n")]
    return "\n\n".join(blocks)


def public(name: str, stub: Mapping[str, object]) -> list[str]:
    """The methods and properties of a class of the package. The native part has them in no order of its own."""
    if name in stub:
        return [inner for inner in stub if inner.startswith(f"{name}.")]
    value = getattr(isotherm, name)
    if not isinstance(value, type) or name == "Flags":
        return []
    return [f"{name}.{inner}" for inner, of in vars(value).items() if not inner.startswith("_") and getattr(of, "__doc__", None)]


def page(stub: str) -> str:
    """The reference page."""
    types = dict(members(ast.parse(stub)))
    names = [name for name in isotherm.__all__ if not isinstance(getattr(isotherm, name), (str, type(isotherm.RAW_SAMPLE)))]
    exceptions = [name for name in names if isinstance(getattr(isotherm, name), type) and issubclass(getattr(isotherm, name), Exception)]
    names = [name for name in names if name not in exceptions and name != "Records"]
    placed = {name for part in PARTS.values() for name in part}
    streams = [name for name in ("Acquisition", "Loan", "Triad", "Increment", "IncrementReader", "Flags", "flag_names", "device") if name in names]
    rest = [name for name in names if name not in placed and name not in streams]
    text = HEAD
    for title, part in {"Streams": streams, **PARTS, "Recordings and other functions": rest, "Exceptions": exceptions}.items():
        text += f"\n## {title}\n"
        for name in part:
            text += entry(name, types, "###")
            for inner in public(name, types):
                text += entry(inner, types, "####")
    return text


def main() -> None:
    stub = with_texts(STUB.read_text())
    for path, text in ((STUB, stub), (PAGE, page(stub))):
        if "--check" not in sys.argv:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            sys.exit(f"{path.relative_to(FOLDER.parent)} is not up to date: run python/reference.py with the package installed")


if __name__ == "__main__":
    main()
