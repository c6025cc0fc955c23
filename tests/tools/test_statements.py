"""Every statement is found, wherever it stands, and no expression is."""

from __future__ import annotations

import ast

from tools.statements import statements_of

MODULE = """\
class A:
    def f(self):
        with x:
            for y in z:
                async def g(): return [lambda: h]
            else:
                def k(): pass
try:
    if a: pass
    elif b:
        def m(): pass
except E:
    def n(): pass
else:
    def o(): pass
finally:
    while c:
        def p(): pass
match d:
    case 1:
        def q(): pass
"""


def test_every_function_is_found_in_the_order_of_the_source():
    found = statements_of(ast.parse(MODULE).body)
    names = [node.name for node in found if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    assert names == ["f", "g", "k", "m", "n", "o", "p", "q"]


def test_nothing_is_left_out_that_a_walk_finds():
    tree = ast.parse(MODULE)
    walked = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    found = [node for node in statements_of(tree.body) if isinstance(node, ast.stmt)]
    assert sorted(map(id, found)) == sorted(map(id, walked))
    assert not any(isinstance(node, ast.expr) for node in statements_of(tree.body))
