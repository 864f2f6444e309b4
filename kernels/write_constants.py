"""Writes numbers that modules of the protocol name into a C++ header, so that both languages know the same.

Usage: write_constants.py HEADER MODULE…, by CMake when it configures. Taken is what a module names in capitals and
computes from numbers alone. The header has each as kLikeThis, and all by name, for the test that they are not stale.
"""

import ast
import struct
import sys
from pathlib import Path

ARITHMETIC = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.Load)


def constants(module: Path) -> dict[str, float]:
    """The numbers of a module, by name."""
    found: dict[str, float] = {}
    for line in ast.parse(module.read_text(encoding="utf-8")).body:
        match line:
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name.isupper() and _is_number(value, found):
                found[name] = eval(compile(ast.Expression(value), str(module), "eval"), {}, dict(found))
    return {name: value for name, value in found.items() if isinstance(value, int | float)}


def header(numbers: dict[str, float]) -> str:
    """The header's text."""
    named = [f"constexpr {_typed(name, value)};" for name, value in numbers.items()]
    listed = [f'    {{"{name}", {_cpp_name(name)}}},' for name in numbers]
    return "\n".join(
        [
            "// Written by kernels/write_constants.py.",
            "#pragma once",
            "",
            "namespace volsplat {",
            "",
            *named,
            "",
            "struct NamedConstant {",
            "    const char* name;",
            "    double value;",
            "};",
            "constexpr NamedConstant kConstants[] = {",
            *listed,
            "};",
            "",
            "}  // namespace volsplat",
            "",
        ]
    )


def _is_number(value: ast.expr, known: dict[str, float]) -> bool:
    return all(
        node.id in known if isinstance(node, ast.Name) else isinstance(node, ARITHMETIC) for node in ast.walk(value)
    )


def _cpp_name(name: str) -> str:
    return "k" + "".join(word.capitalize() for word in name.split("_"))


def _typed(name: str, value: float) -> str:
    if isinstance(value, int):
        return f"{'int' if -(1 << 31) <= value < 1 << 31 else 'long long'} {_cpp_name(name)} = {value}"
    is_float = struct.unpack("f", struct.pack("f", value))[0] == value
    return f"{'float' if is_float else 'double'} {_cpp_name(name)} = {value!r}{'f' * is_float}"


def main(target: Path, modules: list[Path]) -> None:
    """Leaves a header that is up to date alone, so that nothing is compiled again."""
    text = header({name: value for module in modules for name, value in constants(module).items()})
    if not target.exists() or target.read_text(encoding="utf-8") != text:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
