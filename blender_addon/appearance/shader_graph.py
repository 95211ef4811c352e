"""What of a material's nodes reaches its render: the shaders before the active output, and what is linked to them.

Every step asks here, so that nodes that are lying about unlinked count in none. The walk goes backwards from the output
through groups, reroutes and muted nodes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy

# Nodes that are no shaders but pass them on.
_PASSING = {"REROUTE", "GROUP_INPUT", "MIX_SHADER", "ADD_SHADER"}


@dataclass(frozen=True)
class End:
    """An input of a node.

    socket: the input. groups: the group nodes around it, from the material's own tree inwards.
    """

    socket: Any
    groups: tuple[Any, ...] = ()

    def input(self, name: str | int) -> "End":
        """Another input of the node."""
        return End(self.socket.node.inputs[name], self.groups)


@dataclass(frozen=True)
class Shader:
    """A shader that reaches the output.

    node: the shader. groups: as of :class:`End`.
    """

    node: Any
    groups: tuple[Any, ...]

    def end(self, name: str) -> End | None:
        """Its input of that name, None if it has none."""
        socket = self.node.inputs.get(name)
        return None if socket is None else End(socket, self.groups)


def uses_nodes(material: Any) -> bool:
    """Whether a material is rendered by its nodes. Before Blender 5.0 it may have some that are switched off."""
    return material.node_tree is not None and (bpy.app.version >= (5, 0) or material.use_nodes)


def output_of(material: Any) -> Any:
    """The output node that the scene's render engine shows of a material, None if there is none."""
    return next(iter(_outputs_of(material)), None)


def _outputs_of(material: Any) -> list[Any]:
    """The material's outputs for all engines: first that for the scene's own."""
    targets = ["CYCLES", "ALL", "EEVEE"]
    if "EEVEE" in bpy.context.scene.render.engine:
        targets.reverse()
    found = [material.node_tree.get_output_node(target) for target in targets] if uses_nodes(material) else []
    return [output for number, output in enumerate(found) if output is not None and output not in found[:number]]


def shaders_of(material: Any, *, all_engines: bool = False) -> list[Shader]:
    """The shaders that reach the material's output, those in groups once for each of their group nodes.

    all_engines: also those that reach an output for another engine than the scene's.
    """
    outputs = _outputs_of(material)
    todo = [End(output.inputs["Surface"]) for output in (outputs if all_engines else outputs[:1])]
    seen, found = set(), []
    while todo:
        end = todo.pop(0)
        for output in _linked(end.socket):
            place = output.as_pointer(), tuple(group.as_pointer() for group in end.groups)
            if place in seen:
                continue
            seen.add(place)
            todo += _before(output, end.groups)
            node = output.node
            if output.type == "SHADER" and not (node.mute or node.type in _PASSING or hasattr(node, "node_tree")):
                found.append(Shader(node, end.groups))
    return list(dict.fromkeys(found))


def before(end: End) -> tuple[Any, End]:
    """The output that an input is linked to in the end, None if it is not; and the last input on the way to it.

    Where there is no output, the value of that input counts.
    """
    while outputs := _linked(end.socket):
        node = outputs[0].node
        if not (node.mute or node.type in {"REROUTE", "GROUP_INPUT"} or hasattr(node, "node_tree")):
            return outputs[0], end
        further = next(_before(outputs[0], end.groups), None)
        if further is None:
            break
        end = further
    return None, end


def node_before(end: End) -> tuple[Any, tuple[Any, ...]]:
    """The node that an input is linked to in the end, None if it is not; and the group nodes around it."""
    output, last = before(end)
    return (None if output is None else output.node), last.groups


def nodes_behind(end: End) -> list[Any]:
    """All nodes that an input depends on, also those in groups, but for the group nodes themselves."""
    todo, found = [end], []
    while todo:
        end = todo.pop()
        for output in _linked(end.socket):
            if output.node not in found or output.node.type in {"REROUTE", "GROUP_INPUT"}:
                found.append(output.node)
                todo += _before(output, end.groups)
    return [node for node in dict.fromkeys(found) if not hasattr(node, "node_tree")]


def way_in(end: End) -> Any:
    """The input in the material's own tree through which a link reaches an input in groups, None if there is none.

    Groups are not changed, as other materials may use them. In a group, bumps may lie between.
    """
    socket, groups = end.socket, end.groups
    while groups:
        outputs = _linked(socket)
        if not outputs:
            return None
        node = outputs[0].node
        if node.type == "BUMP" and not node.mute:
            socket = node.inputs["Normal"]
        elif node.mute or node.type in {"REROUTE", "GROUP_INPUT"}:
            further = next(_before(outputs[0], groups), None)
            if further is None:
                return None
            socket, groups = further.socket, further.groups
        else:
            return None
    return socket


def normal_inputs(material: Any) -> tuple[list[Any], list[str]]:
    """The inputs in a material's own tree that take the normal of its shaders, for all render engines.

    A shader's second normal, that of its coat, is among them if it is linked to what the first one is. Also returned is
    a sentence for each shader in a group that takes no normal from outside, or for a group with an output of its own.
    """
    if uses_nodes(material) and (inner := _group_with_output(material.node_tree)):
        return [], [
            f'The group "{inner}" in material "{material.name}" holds a Material Output, which is rendered in place '
            "of the material's own; delete it"
        ]
    found: list[Any] = []
    closed: list[str] = []
    for shader in shaders_of(material, all_engines=True):
        normal = shader.end("Normal")
        if normal is None:
            continue
        linked = before(normal)[0]
        coats = [End(one, shader.groups) for one in shader.node.inputs if one.name.endswith(" Normal") and one.enabled]
        same = [coat for coat in coats if linked is not None and before(coat)[0] == linked]
        sockets = [way_in(end) for end in (normal, *same)]
        found += [socket for socket in sockets if socket is not None and socket not in found]
        if sockets[0] is None:
            closed.append(
                f'The group "{shader.groups[-1].node_tree.name}" in material "{material.name}" takes no normal for its '
                f'shader "{shader.node.name}"; add an input for it to the group'
            )
    return found, list(dict.fromkeys(closed))


def _group_with_output(tree: Any) -> str:
    """The name of a group in a tree that holds a Material Output, "" if there is none."""
    for node in tree.nodes:
        inner = getattr(node, "node_tree", None)
        if inner is not None and any(one.type == "OUTPUT_MATERIAL" for one in inner.nodes):
            return str(inner.name)
        if inner is not None and (found := _group_with_output(inner)):
            return found
    return ""


def _linked(socket: Any) -> list[Any]:
    return [link.from_socket for link in socket.links if not link.is_muted]


def _before(output: Any, groups: tuple[Any, ...]) -> Iterator[End]:
    """The inputs that an output depends on."""
    node = output.node
    if node.mute:
        yield from (End(link.from_socket, groups) for link in node.internal_links if link.to_socket == output)
    elif node.type == "GROUP_INPUT":
        yield from (End(one, groups[:-1]) for one in groups[-1].inputs if one.identifier == output.identifier)
    elif hasattr(node, "node_tree"):
        ends = [one for one in node.node_tree.nodes if one.type == "GROUP_OUTPUT"] if node.node_tree else []
        inside = (one for end in ends if end.is_active_output for one in end.inputs)
        yield from (End(one, (*groups, node)) for one in inside if one.identifier == output.identifier)
    else:
        yield from (End(one, groups) for one in node.inputs if one.enabled and one not in _hidden(node, groups))


def _hidden(node: Any, groups: tuple[Any, ...]) -> list[Any]:
    """The shader of a Mix Shader that its factor hides, if nothing changes the factor."""
    if node.type != "MIX_SHADER" or node.id_data.animation_data is not None:
        return []
    output, last = before(End(node.inputs[0], groups))
    constant = last.socket if output is None else output
    if constant.id_data.animation_data is not None or (output is not None and output.node.type != "VALUE"):
        return []
    factor = constant.default_value
    if 0 < factor < 1:
        return []
    return [node.inputs[2 if factor <= 0 else 1]]
