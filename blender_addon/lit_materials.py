# SPDX-License-Identifier: GPL-3.0-or-later
"""Lit copies of materials: in each, a node group that multiplies base colour by the lightmap replaces diffuse shaders.

The lightmap holds irradiance / π, so a surface shows reflectance × texel. Mix, Add and Transparent shaders stay, and
so does what a lightmap cannot show: metal, glass and emission.
"""

from __future__ import annotations

import bpy

SOURCE = "lightkiln_source"
# Marks node groups: those that show a lightmap, and copies of the user's groups. Marks of trees must not refer to other
# data: Blender copies trees for drawing without counting such references.
SHOWS, COPY = "lightkiln_shows", "lightkiln_copy"
# On a node of a lit copy: the name of the shader that it stands for.
STANDS_FOR = "lightkiln_for"
LIGHTMAP = "Lightmap"
LIGHT_ONLY = "Light Only"
# Reflectance that the light is shown on alone.
GREY = (0.8, 0.8, 0.8, 1.0)
_INPUTS = (
    ("Base Color", "NodeSocketColor", (0.8, 0.8, 0.8, 1.0)),
    ("Metallic", "NodeSocketFloat", 0.0),
    ("Transmission Weight", "NodeSocketFloat", 0.0),
    ("Alpha", "NodeSocketFloat", 1.0),
    ("Emission Color", "NodeSocketColor", (1.0, 1.0, 1.0, 1.0)),
    ("Emission Strength", "NodeSocketFloat", 0.0),
)
# Diffuse shaders, and which of their inputs feeds which of the group's.
REPLACED = {
    "ShaderNodeBsdfPrincipled": {name: name for name, _, _ in _INPUTS},
    "ShaderNodeBsdfDiffuse": {"Color": "Base Color"},
    "ShaderNodeSubsurfaceScattering": {"Color": "Base Color"},
    "ShaderNodeBsdfSheen": {"Color": "Base Color"},
}


def lit_material(
    source: bpy.types.Material | None, image: bpy.types.Image, uv_map: str, attribute: str
) -> bpy.types.Material:
    """A copy of a material that shows the lightmap."""
    if source is None:
        material = bpy.data.materials.new("Lightmap")
    else:
        material = source.copy()
        material.name = f"{source.name} Lightmap"
        material[SOURCE] = source.name
    if not getattr(material, "use_nodes", True) or material.node_tree is None:
        material.use_nodes = True
    # The surface shows light that was baked; it must not be sampled as a lamp.
    if hasattr(material, "cycles") and hasattr(material.cycles, "emission_sampling"):
        material.cycles.emission_sampling = "NONE"
    group = _group(image, uv_map, attribute)
    for output in [n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial"]:
        _replace(material.node_tree, output.inputs["Surface"], group, {})
    return material


def _replace(
    tree: bpy.types.NodeTree,
    socket: bpy.types.NodeSocket,
    group: bpy.types.NodeTree,
    done: dict[bpy.types.Node, bpy.types.Node],
) -> None:
    """Replaces the diffuse shaders that feed an input."""
    if not socket.links:
        return
    link = socket.links[0]
    node, output = link.from_node, link.from_socket
    kind = node.bl_idname
    if kind in {"ShaderNodeMixShader", "ShaderNodeAddShader", "NodeReroute"}:
        for inner in node.inputs:
            if inner.type == "SHADER":
                _replace(tree, inner, group, done)
    elif kind == "ShaderNodeGroup" and node.node_tree is not None:
        if COPY not in node.node_tree:
            node.node_tree = node.node_tree.copy()
            node.node_tree[COPY] = True
        for end in [n for n in node.node_tree.nodes if n.bl_idname == "NodeGroupOutput"]:
            inner = next((i for i in end.inputs if i.identifier == output.identifier), None)
            if inner is not None:
                _replace(node.node_tree, inner, group, done)
    elif kind in REPLACED and not _is_mirror_or_glass(node):
        if node not in done:
            done[node] = _stand_in(tree, node, group)
        tree.links.new(done[node].outputs[0], socket)


def _is_mirror_or_glass(node: bpy.types.Node) -> bool:
    names = ("Metallic", "Transmission Weight")
    inputs = [node.inputs[name] for name in names if name in node.inputs]
    return any(not i.is_linked and i.default_value >= 0.999 for i in inputs)


def _stand_in(tree: bpy.types.NodeTree, node: bpy.types.Node, group: bpy.types.NodeTree) -> bpy.types.Node:
    """The group in the place of a shader, fed by what fed the shader."""
    lit = tree.nodes.new("ShaderNodeGroup")
    lit.node_tree = group
    lit[STANDS_FOR] = node.name
    lit.location = (node.location.x, node.location.y + 220)
    for theirs, ours in REPLACED[node.bl_idname].items():
        if theirs in node.inputs:
            fed = node.inputs[theirs]
            lit.inputs[ours].default_value = fed.default_value
            if fed.links:
                tree.links.new(fed.links[0].from_socket, lit.inputs[ours])
    return lit


def _group(image: bpy.types.Image, uv_map: str, attribute: str) -> bpy.types.NodeTree:
    """The node group for a UV map and a place, made on first use."""
    for tree in bpy.data.node_groups:
        if _shows(tree, image) and tree.get("uv_map") == uv_map and tree.get("attribute") == attribute:
            return tree
    tree = bpy.data.node_groups.new("Lightkiln", "ShaderNodeTree")
    tree[SHOWS], tree["uv_map"], tree["attribute"] = True, uv_map, attribute
    for name, kind, default in _INPUTS:
        tree.interface.new_socket(name, in_out="INPUT", socket_type=kind).default_value = default
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    _fill(tree, image, uv_map, attribute)
    return tree


def _fill(tree: bpy.types.NodeTree, image: bpy.types.Image, uv_map: str, attribute: str) -> None:
    """Builds (1 − metal)(1 − glass) · base · lightmap(UV · scale + offset) + emission, mixed with nothing by alpha."""
    nodes, links = tree.nodes, tree.links

    def add(kind: str, column: int, row: int, **settings: object) -> bpy.types.Node:
        node = nodes.new(kind)
        node.location = (180 * column, -160 * row)
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    def vector(operation: str, column: int, row: int, a: object, b: object) -> bpy.types.NodeSocket:
        node = add("ShaderNodeVectorMath", column, row, operation=operation)
        for socket, value in zip(node.inputs, (a, b), strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return node.outputs["Vector"]

    start = add("NodeGroupInput", 0, 3)
    coordinate = add("ShaderNodeUVMap", 0, 0, uv_map=uv_map).outputs["UV"]
    place = add("ShaderNodeAttribute", 0, 1, attribute_type="INSTANCER", attribute_name=attribute)
    scale_x_y_offset_x = add("ShaderNodeSeparateXYZ", 1, 1)
    links.new(place.outputs["Vector"], scale_x_y_offset_x.inputs[0])
    scale, offset = add("ShaderNodeCombineXYZ", 2, 0), add("ShaderNodeCombineXYZ", 2, 1)
    links.new(scale_x_y_offset_x.outputs["X"], scale.inputs["X"])
    links.new(scale_x_y_offset_x.outputs["Y"], scale.inputs["Y"])
    links.new(scale_x_y_offset_x.outputs["Z"], offset.inputs["X"])
    links.new(place.outputs["Alpha"], offset.inputs["Y"])
    scaled = vector("MULTIPLY", 3, 0, coordinate, scale.outputs[0])
    texture = add("ShaderNodeTexImage", 5, 0, name=LIGHTMAP, image=image, extension="EXTEND", interpolation="Linear")
    links.new(vector("ADD", 4, 0, scaled, offset.outputs[0]), texture.inputs["Vector"])

    base = vector("SCALE", 2, 3, start.outputs["Base Color"], None)
    base.node.inputs["Scale"].default_value = 1.0
    for column, name in ((2, "Metallic"), (3, "Transmission Weight")):
        rest = add("ShaderNodeMath", column, 4, operation="SUBTRACT")
        rest.inputs[0].default_value = 1.0
        links.new(start.outputs[name], rest.inputs[1])
        if column == 2:
            links.new(rest.outputs[0], base.node.inputs["Scale"])
        else:
            base = vector("SCALE", 4, 3, base, None)
            links.new(rest.outputs[0], base.node.inputs["Scale"])
    light_only = add("ShaderNodeValue", 4, 2, name=LIGHT_ONLY, label=LIGHT_ONLY)
    light_only.outputs[0].default_value = 0.0
    shown = add("ShaderNodeMix", 5, 2, data_type="RGBA")
    sockets = {s.identifier: s for s in shown.inputs}
    sockets["B_Color"].default_value = GREY
    links.new(light_only.outputs[0], sockets["Factor_Float"])
    links.new(base, sockets["A_Color"])
    color = next(s for s in shown.outputs if s.identifier == "Result_Color")
    lit = vector("MULTIPLY", 6, 1, color, texture.outputs["Color"])

    emission = vector("SCALE", 6, 3, start.outputs["Emission Color"], None)
    links.new(start.outputs["Emission Strength"], emission.node.inputs["Scale"])
    shader = add("ShaderNodeEmission", 8, 1)
    links.new(vector("ADD", 7, 1, lit, emission), shader.inputs["Color"])
    nothing, mix = add("ShaderNodeBsdfTransparent", 8, 0), add("ShaderNodeMixShader", 9, 1)
    links.new(start.outputs["Alpha"], mix.inputs[0])
    links.new(nothing.outputs[0], mix.inputs[1])
    links.new(shader.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], add("NodeGroupOutput", 10, 1).inputs[0])


def _shows(tree: bpy.types.NodeTree, image: bpy.types.Image) -> bool:
    return SHOWS in tree and tree.nodes[LIGHTMAP].image == image


def set_light_only(image: bpy.types.Image | None, on: bool) -> None:
    """Lets the groups of a lightmap show the light on grey, or the lit surface."""
    for tree in bpy.data.node_groups:
        if image is not None and _shows(tree, image):
            tree.nodes[LIGHT_ONLY].outputs[0].default_value = float(on)


def remove_groups() -> None:
    """Removes the node groups of lightmaps, and copies of the user's groups, that nobody uses any more."""
    for tree in list(bpy.data.node_groups):
        # A user's group that was copied may hold one of ours, so it goes first.
        if tree.get(COPY) and tree.users == 0:
            bpy.data.node_groups.remove(tree)
    for tree in list(bpy.data.node_groups):
        if SHOWS in tree and tree.users == 0:
            bpy.data.node_groups.remove(tree)
