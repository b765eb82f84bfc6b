"""Where the pieces of the dungeon hall stand.

The kit's grid is 4 m: a wall piece is 4 m wide and high and stands on a cell's edge with its front along +Z; a corner
has two arms of 2 m. The hall is 3 by 5 cells and two storeys high (x 0 to 12, z 0 to 20, y 0 to 8), with the door at
z = 0 and a gallery on pillars at z 16 to 20, which the stairs reach.
"""

from __future__ import annotations

from dataclasses import dataclass

WIDTH, LENGTH, STOREY, CELL = 12.0, 20.0, 4.0, 4.0
WALL_FACE = 0.25  # half the thickness of a wall
FLOOR = 0.04  # the floor's surface is at 0.05: what stands on it sinks in by a centimetre, so that no faces coincide


@dataclass(frozen=True)
class Placement:
    """One piece: its name in the kit, its position in metres, its turn about +Y in degrees."""

    piece: str
    x: float
    y: float
    z: float
    turn: float = 0.0
    scale: float = 1.0
    upside_down: bool = False


def grid() -> list[tuple[float, float]]:
    """Centres of the cells."""
    columns, rows = int(WIDTH / CELL), int(LENGTH / CELL)
    return [((i + 0.5) * CELL, (k + 0.5) * CELL) for k in range(rows) for i in range(columns)]


ROOF_HOLE = (6.0, 10.0)


def shell() -> list[Placement]:
    """Floor, ceiling with a hole, gallery and the walls of both storeys."""
    placements = []
    for x, z in grid():
        broken = (x, z) in (ROOF_HOLE, (10.0, 6.0))
        placements.append(Placement("floor_tile_large_rocks" if broken else "floor_tile_large", x, 0.0, z))
        if (x, z) != ROOF_HOLE:
            placements.append(Placement("floor_wood_large_dark", x, 2 * STOREY, z, upside_down=True))
            # Its back is open: a roof keeps the sky out of the joints with the walls.
            placements.append(Placement("floor_tile_large", x, 2 * STOREY + 0.2, z))
    for x in (2.0, 6.0, 10.0):
        # Floor pieces have no underside: a second one, set back a little, closes the gallery from below.
        placements.append(Placement("floor_wood_large", x, STOREY, 18.0))
        placements.append(Placement("floor_wood_large_dark", x, STOREY - 0.06, 18.02, upside_down=True))
    for y in (0.0, STOREY):
        placements += [
            Placement("wall_corner", 0.0, y, 0.0, 90),
            Placement("wall_corner", WIDTH, y, 0.0, 0),
            Placement("wall_corner", WIDTH, y, LENGTH, 270),
            Placement("wall_corner", 0.0, y, LENGTH, 180),
        ]
    door_side = [["wall_shelves", "wall_doorway"], ["wall_archedwindow_gated", "wall_archedwindow_gated"]]
    gallery_side = [["wall_arched", "wall_arched"], ["wall", "wall"]]
    left = [
        ["wall", "wall_window_open", "wall", "wall"],
        ["wall_archedwindow_open", "wall", "wall_archedwindow_open", "wall"],
    ]
    right = [
        ["wall", "wall_archedwindow_gated", "wall", "wall_window_open"],
        ["wall_archedwindow_open", "wall", "wall_archedwindow_open", "wall"],
    ]
    for storey in range(2):
        y = storey * STOREY
        for i in range(2):
            placements.append(Placement(door_side[storey][i], CELL * (i + 1), y, 0.0, 0))
            placements.append(Placement(gallery_side[storey][i], CELL * (i + 1), y, LENGTH, 180))
        for i in range(4):
            placements.append(Placement(left[storey][i], 0.0, y, CELL * (i + 1), 90))
            placements.append(Placement(right[storey][i], WIDTH, y, CELL * (i + 1), 270))
    return placements


def structure() -> list[Placement]:
    """Pillars, stairs and the gallery's balustrade."""
    placements = [
        Placement(piece, x, y, z)
        for x in (3.2, 8.8)
        for z in (4.5, 9.5)
        for y, piece in ((FLOOR, "pillar_decorated" if (x, z) == (8.8, 9.5) else "pillar"), (STOREY + 0.01, "pillar"))
    ]
    placements += [
        Placement("pillar", 6.0, FLOOR - 0.1, 16.9),
        Placement("pillar", 10.2, FLOOR - 0.1, 16.9),
        Placement("stairs_narrow", 2.6, FLOOR, 15.99, 180),
        Placement("barrier", 6.75, STOREY + FLOOR, 16.3),
        Placement("barrier_half", 8.75, STOREY + FLOOR, 16.3),
        Placement("column", 11.1, STOREY + FLOOR, 16.36),
    ]
    return placements


def furniture() -> list[Placement]:
    """The table with what stands on it, stores, chests and banners."""
    table = FLOOR + 1.0
    gallery = STOREY + FLOOR
    return [
        Placement("table_long", 6.0, FLOOR, 5.4),
        Placement("chair", 4.75, FLOOR, 4.7, 90),
        Placement("chair", 4.8, FLOOR, 6.2, 80),
        Placement("chair", 7.25, FLOOR, 4.6, 270),
        Placement("chair", 7.4, FLOOR, 6.1, 250),
        Placement("stool", 6.1, FLOOR, 8.0, 20),
        Placement("plate_food_A", 5.5, table, 4.6, 30),
        Placement("plate_food_B", 6.45, table, 6.3, 200),
        Placement("plate", 6.5, table, 4.5),
        Placement("plate_small", 5.5, table, 6.2),
        Placement("plate_stack", 5.55, table, 7.0, 60),
        Placement("bottle_A_brown", 6.2, table, 5.1),
        Placement("bottle_C_green", 5.8, table, 5.75),
        Placement("bottle_A_brown", 6.6, table, 7.0),
        Placement("candle_lit", 6.0, table, 5.35),
        Placement("candle_lit", 6.05, table, 6.6, 140),
        Placement("barrel_large", 10.5, FLOOR, 1.6),
        Placement("barrel_large", 10.6, FLOOR, 3.6, 40),
        Placement("barrel_small", 9.2, FLOOR, 1.2, 15),
        Placement("barrel_small", 11.0, FLOOR, 14.9, 70),
        Placement("barrel_small", 9.9, FLOOR, 15.2, 120),
        Placement("crates_stacked", 1.7, FLOOR, 1.8, 90),
        Placement("box_large", 10.7, FLOOR, 8.3, 12),
        Placement("box_small", 10.6, FLOOR + 1.5, 8.2, 33),
        Placement("box_small", 10.9, FLOOR, 9.9, 5),
        Placement("box_small", 1.0, FLOOR, 10.4, 8),
        Placement("keg", 7.9, FLOOR, 18.6, 180),
        Placement("keg", 10.1, FLOOR, 18.6, 180),
        Placement("barrel_large", 5.6, FLOOR, 18.7, 10),
        Placement("trunk_medium_A", 1.0, FLOOR, 8.2, 90),
        Placement("chest_gold", 7.0, gallery, 18.6, 180),
        Placement("chest", 9.6, gallery, 18.7, 195),
        Placement("coin_stack_small", 8.2, gallery, 18.2),
        Placement("coin_stack_small", 5.7, gallery, 18.5, 130),
        Placement("rubble_large", 6.3, FLOOR - 0.05, 11.2, 25, scale=0.4),
        Placement("banner_patternA_red", WIDTH, 0.0, 12.0, 270),
        Placement("banner_patternA_red", WIDTH, STOREY, 8.0, 270),
        Placement("banner_patternA_red", 0.0, STOREY, 8.0, 90),
        Placement("banner_shield_blue", 0.0, 0.0, 12.0, 90),
        Placement("banner_triple_red", 6.0, STOREY, LENGTH, 180),
    ]


def torches() -> list[Placement]:
    """Mounted torches, each of which gets a flame."""
    height = 2.3
    right, back = WIDTH - WALL_FACE, LENGTH - WALL_FACE
    return [
        Placement("torch_mounted", WALL_FACE, height, 4.0, 90),
        Placement("torch_mounted", right, height, 4.0, 270),
        Placement("torch_mounted", right, height, 14.0, 270),
        Placement("torch_mounted", 6.0, height, WALL_FACE, 0),
        Placement("torch_mounted", 8.9, height, back, 180),
        Placement("torch_mounted", 3.0, STOREY + height, back, 180),
        Placement("torch_mounted", 9.0, STOREY + height, back, 180),
        Placement("torch_mounted", WALL_FACE, STOREY + height, 16.0, 90),
    ]


def placements() -> list[Placement]:
    """Every piece of the hall."""
    return shell() + structure() + furniture() + torches()
