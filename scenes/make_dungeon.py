"""Assembles dungeon.glb from pieces of the KayKit dungeon kit.

    python3 scenes/make_dungeon.py [KIT_FOLDER] [OUT.glb]

KIT_FOLDER holds the kit's .glb pieces; `kaykit/` beside this script has those that the hall uses. Each kind of piece
becomes one mesh that its placements share, and all share one texture. The flames of torches and candles are cut out
into meshes of their own that emit, with the texture's flame colours as radiance. The sky is a dim dusk gradient.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from dungeon_layout import WIDTH, Placement, placements
from glb import EXTENSION, Geometry, Glb, Json, Vector, look_along, turn_x, turn_y

HERE = Path(__file__).parent

# The flame's gradient in the shared texture, as texture coordinates (u, v).
FLAME_LOW, FLAME_HIGH = (0.9, 0.5), (0.96, 0.75)
FLAME_RADIANCE = 480.0  # W/(m²·sr) where the texture is white
# From a free torch's flame to the bowl of a mounted one, which leans away from the wall.
MOUNTED_FLAME = (0.0, -0.015, 0.32)

SKY = {"gradient": {"zenith": [0.90, 1.25, 2.00], "horizon": [2.40, 1.90, 1.60], "ground": [0.20, 0.18, 0.16]}}
DOOR_AJAR_DEGREES = 62.0


@dataclass
class Kit:
    """Reads pieces and adds each to the document once."""

    folder: Path
    glb: Glb
    surface: int
    flame: int
    meshes: dict[str, int]

    @staticmethod
    def open(folder: Path, glb: Glb) -> Kit:
        """A kit whose materials and texture are in the document."""
        piece = Glb.read(folder / "torch_lit.gltf.glb")
        pixels = piece.view_bytes(piece.json["images"][0]["bufferView"])
        image = {"name": "dungeon_texture", "mimeType": "image/png", "bufferView": glb.add_view(pixels)}
        glb.json["images"] = [image]
        glb.json["textures"] = [{"source": 0}]
        texture = {"index": 0}
        surface: Json = {"baseColorTexture": texture, "metallicFactor": 0.0, "roughnessFactor": 0.9}
        black: Json = {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
        flame = {
            "name": "flame",
            "pbrMetallicRoughness": black,
            "emissiveTexture": texture,
            "emissiveFactor": [1.0, 1.0, 1.0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": FLAME_RADIANCE}},
        }
        glb.use_extension("KHR_materials_emissive_strength")
        surface_index = glb.append("materials", {"name": "dungeon", "pbrMetallicRoughness": surface})
        return Kit(folder, glb, surface_index, glb.append("materials", flame), {})

    def read(self, name: str) -> Glb:
        """The piece as a document."""
        path = self.folder / f"{name}.gltf.glb"
        return Glb.read(path if path.exists() else self.folder / f"{name}.glb")

    def mesh(self, name: str, geometry: Geometry, material: int) -> int:
        """The mesh of that name, added on first use."""
        if name not in self.meshes:
            primitive = self.glb.add_primitive(geometry, material)
            self.meshes[name] = self.glb.append("meshes", {"name": name, "primitives": [primitive]})
        return self.meshes[name]

    def flame_node(self, piece: str, translation: Vector) -> int:
        """A node with the flame of a lit piece. A flame has no lightmap: it only emits."""
        source = self.read(piece)
        geometry = source.geometry(source.json["meshes"][0]["primitives"][0])
        mesh = self.mesh(f"{piece} flame", turned(split_flame(geometry)[1]), self.flame)
        node: Json = {"name": "flame", "mesh": mesh, "extensions": {EXTENSION: {"lightmap": False}}}
        if any(translation):
            node["translation"] = list(translation)
        return self.glb.append("nodes", node)

    def nodes(self, name: str) -> list[Json]:
        """The piece's nodes, root first; children are indices into the document."""
        source = self.read(name)
        built: dict[int, Json] = {}

        def build(index: int) -> Json:
            node = source.json["nodes"][index]
            geometry = source.geometry(source.json["meshes"][node["mesh"]]["primitives"][0])
            mesh = self.mesh(node["name"], split_flame(geometry)[0], self.surface)
            built[index] = {"name": node["name"], "mesh": mesh}
            if "translation" in node:
                built[index]["translation"] = node["translation"]
            children = [self.glb.append("nodes", build(child)) for child in node.get("children", [])]
            if children:
                built[index]["children"] = children
            return built[index]

        root = build(source.json["scenes"][0]["nodes"][0])
        return [root, *(n for n in built.values() if n is not root)]


def split_flame(geometry: Geometry) -> tuple[Geometry, Geometry]:
    """The triangles outside and inside the flame's part of the texture."""
    uv = geometry.texcoords[0]
    parts: tuple[list[int], list[int]] = ([], [])
    for i in range(0, len(geometry.indices), 3):
        corners = geometry.indices[i : i + 3]
        burns = all(FLAME_LOW[k] < uv[c][k] < FLAME_HIGH[k] for c in corners for k in (0, 1))
        parts[burns].extend(corners)
    return subset(geometry, parts[0]), subset(geometry, parts[1])


def subset(geometry: Geometry, indices: list[int]) -> Geometry:
    """The triangles with these corners and no unused vertices."""
    used = sorted(set(indices))
    place = {old: new for new, old in enumerate(used)}
    return Geometry(
        positions=[geometry.positions[i] for i in used],
        normals=[geometry.normals[i] for i in used],
        texcoords=[[geometry.texcoords[0][i] for i in used]],
        indices=[place[i] for i in indices],
    )


def turned(geometry: Geometry) -> Geometry:
    """The same triangles facing the other way. The kit's flames face inwards, and emission leaves the front only."""
    indices = [geometry.indices[i + k] for i in range(0, len(geometry.indices), 3) for k in (0, 2, 1)]
    normals: list[Vector] = [(-x, -y, -z) for x, y, z in geometry.normals]
    return Geometry(geometry.positions, normals, geometry.texcoords, indices)


def add_piece(kit: Kit, placement: Placement, name: str) -> None:
    """Places a piece, with its flame if it burns and its door ajar if it has one."""
    nodes = kit.nodes(placement.piece)
    root = nodes[0]
    root["name"] = name
    root["translation"] = [placement.x, placement.y, placement.z]
    if placement.upside_down:
        root["rotation"] = turn_x(180)
    elif placement.turn:
        root["rotation"] = turn_y(placement.turn)
    if placement.scale != 1.0:
        root["scale"] = [placement.scale] * 3
    if placement.piece == "wall_doorway":
        nodes[1]["rotation"] = turn_y(DOOR_AJAR_DEGREES)
    if placement.piece == "torch_mounted":
        root["children"] = [kit.flame_node("torch_lit", MOUNTED_FLAME)]
    if placement.piece == "candle_lit":
        root["children"] = [kit.flame_node("candle_lit", (0.0, 0.0, 0.0))]
    kit.glb.add_root(root)


def main() -> None:
    """Builds and writes the scene."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "kaykit"
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "dungeon.glb"
    glb = Glb.new("lightkiln scenes/make_dungeon.py", "Pieces: KayKit Dungeon Remastered by Kay Lousberg, CC0")
    kit = Kit.open(folder, glb)

    counts: dict[str, int] = {}
    for placement in placements():
        counts[placement.piece] = counts.get(placement.piece, 0) + 1
        add_piece(kit, placement, f"{placement.piece} {counts[placement.piece]:02}")

    glb.set_environment(SKY)
    camera = {"type": "perspective", "perspective": {"aspectRatio": 1.5, "yfov": 1.1, "znear": 0.1, "zfar": 100.0}}
    glb.add_root(
        {
            "name": "Camera",
            "camera": glb.append("cameras", camera),
            "translation": [WIDTH / 2 + 0.7, 3.3, 1.0],
            "rotation": look_along((-0.07, -0.05, 1.0)),
        }
    )
    glb.write(out)
    print(f"{out}: {sum(counts.values())} pieces of {len(counts)} kinds")


if __name__ == "__main__":
    main()
