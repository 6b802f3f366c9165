"""Photos of robots that bend, with all that a kitchen table does to them; the truth is known.

Nothing here knows how `vinefab.observation` looks at film: bodies are grown by a march of their own
(each free stretch has curvature that varies along it, each joint is off by some degrees, children
may stay in), and drawn as wrinkled, translucent tubes with flat seams on a wavy table, under one
hard lamp, through a lens that bends straight lines.
"""

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from scipy import ndimage
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parent))

from rendered_photo import (
    CELL_MM,
    Raster,
    axes_of,
    developed,
    halfway,
    lamp_of,
    linear,
    marker_cells,
    shadow_of,
)

from vinefab.growth.terrain import Terrain
from vinefab.model.map import corner_markers
from vinefab.physics.tube import inflated_radius_mm

STEP_MM = 1.0
RIM_MM = 70.0


# --- Bodies that bend


@dataclass(frozen=True)
class Body:
    """How bodies differ from the model's, and when a tip stops."""

    half_angle_deg: float = 8.0
    bend_per_mm: float = 1 / 600  # standard deviation of the curvature
    knot_mm: float = 60.0  # over which curvature changes
    joint_deg: float = 5.0  # standard deviation of joints' angles
    absent: float = 0.08  # share of children that stay in


@dataclass
class TrueBranch:
    id: str
    level: int
    radius_mm: float
    points_mm: np.ndarray
    stop: str  # full_length, head_on, corner, not_deployed
    contacts: list = field(default_factory=list)  # (x, y, angle from the normal, outcome)


def grow_bent(design, world, pose, body, rng):
    """Return the branches of a robot whose tubes bend and whose joints are off."""
    tree, terrain = design.tree, Terrain.of(world)
    grown = []
    for index in range(len(tree)):
        parent, level = int(tree.parent[index]), int(tree.level[index])
        radius = inflated_radius_mm(design.build.widths_mm[level - 1])
        branch = TrueBranch(tree.ids[index], level, radius, np.zeros((0, 2)), "not_deployed")
        grown.append(branch)
        if parent >= 0:
            before = grown[parent]
            if before.stop != "full_length" or rng.random() < body.absent:
                continue
            way = before.points_mm[-1] - before.points_mm[-4]
            heading = math.atan2(way[1], way[0]) + float(tree.offset_rad[index])
            heading += math.radians(rng.normal(0.0, body.joint_deg))
            base = before.points_mm[-1]
        else:
            heading, base = pose.heading_rad, np.array([pose.x_mm, pose.y_mm])
        march(branch, terrain.free_space(radius), base, heading, tree.length_mm[index], body, rng)
    return grown


def march(branch, free, base, heading, length, body, rng):
    """Grow one branch: its free stretch turns about its last contact when its tip slides."""
    steps = int(length / STEP_MM)
    knots = rng.normal(0.0, body.bend_per_mm, int(length / body.knot_mm) + 2)
    bends = np.interp(np.arange(steps), np.arange(len(knots)) * body.knot_mm, knots)
    turns = np.cumsum(bends) * STEP_MM
    strides = STEP_MM * np.column_stack([np.cos(turns), np.sin(turns)])
    shapely.prepare(free)
    edge = free.boundary
    laid, link, turn = [base], np.zeros((1, 2)), heading  # link: the free stretch, unturned
    touching, side = None, 0.0
    branch.stop = "full_length"
    for stride in strides:
        link = np.vstack([link, link[-1] + stride])
        tip = placed(laid[-1], link[-1:], turn)[0]
        if shapely.contains_xy(free, *tip):
            if touching is not None and edge.distance(shapely.Point(tip)) > 1.0:
                touching = None
            continue
        normal, place = wall_at(edge, free, tip)
        ahead = placed(np.zeros(2), stride[None], turn)[0] / STEP_MM
        steeper = touching is not None and ahead @ normal > ahead @ touching
        if touching is None or (steeper and abs(touching @ normal) < math.cos(math.radians(25.0))):
            angle = math.degrees(math.acos(np.clip(ahead @ normal, -1.0, 1.0)))
            stops = angle <= body.half_angle_deg
            if angle < 88.0:  # else it only brushes past
                branch.contacts.append((*place, angle, "stopped" if stops else "slid"))
            if stops:
                branch.stop, link = "head_on", link[:-1]
                break
            side = 1.0 if normal[0] * ahead[1] - normal[1] * ahead[0] > 0.0 else -1.0
        touching = normal
        turned = slid(free, laid[-1], link, turn, side)
        if turned is None:
            branch.stop, link = "corner", link[:-1]
            break
        turn = turned
        hit = leaning(free, laid[-1], link, turn)
        if hit:
            laid.extend(placed(laid[-1], link[1 : hit + 1], turn))
            link = link[hit:] - link[hit]
    chain = np.vstack([np.array(laid), placed(laid[-1], link[1:], turn)])
    if len(chain) < 5:
        branch.stop, chain = "not_deployed", np.zeros((0, 2))
    branch.points_mm = chain


def placed(pivot, link, turn):
    cosine, sine = math.cos(turn), math.sin(turn)
    return pivot + link @ np.array([[cosine, sine], [-sine, cosine]])


def wall_at(edge, free, tip):
    """Return the normal into the wall at a tip just inside it, and the place."""
    at = edge.project(shapely.Point(tip))
    one, two = (np.array(edge_point(edge, at + off)) for off in (-0.4, 0.4))
    along = (two - one) / max(np.hypot(*(two - one)), 1e-9)
    normal = np.array([along[1], -along[0]])
    place = np.array(edge_point(edge, at))
    if shapely.contains_xy(free, *(place + 0.3 * normal)):
        normal = -normal
    return normal, place


def edge_point(edge, at):
    return edge.interpolate(at).coords[0]


def slid(free, pivot, link, turn, side):
    """Return the turn by which the tip slides out of its wall; None where it is wedged."""
    for more in np.concatenate([np.arange(0.05, 2.0, 0.05), np.arange(2.0, 25.0, 0.5)]):
        tried = turn + side * math.radians(more)
        if shapely.contains_xy(free, *placed(pivot, link[-1:], tried)[0]):
            return tried
    return None


def leaning(free, pivot, link, turn):
    """Return the place of a link, not its ends, that lies in a wall; 0 if none does."""
    if len(link) < 8:
        return 0
    points = placed(pivot, link[3:-3], turn)
    away = ~shapely.contains_xy(free, points)
    if not away.any():
        return 0
    deep = shapely.distance(shapely.points(points[away]), free)
    return 3 + int(np.flatnonzero(away)[deep.argmax()]) if deep.max() > 0.4 else 0


# --- Pictures


@dataclass(frozen=True)
class Unkind:
    """What table, light, film and camera do to a photo."""

    tilt_deg: float = 10.0
    turn_deg: float = 0.0
    roll_deg: float = 0.0
    distance_mm: float = 900.0
    pixels: tuple = (1600, 1200)
    film: tuple = (214, 88, 40)
    board: tuple = (186, 182, 170)
    block: tuple = (90, 110, 140)
    height_mm: float = 30.0
    opacity: float = 0.6  # of one layer of film
    wrinkle: float = 0.04  # of the radius, and of the light on it
    seam_mm: float = 0.4  # flat film on both sides of a tube
    light_deg: tuple = (50.0, 30.0)  # azimuth and height
    shade: float = 0.25  # light that is left in shadows
    wave_mm: float = 1.0  # amplitude of the table
    bend: float = 0.0  # of straight lines, at the photo's corners, as a share
    blur_px: float = 0.8
    noise: float = 3.0
    jpeg: int = 85
    seed: int = 1


def photographed(world, branches, look):
    """Return a JPEG of a robot on its table, as bytes."""
    rng = np.random.default_rng(look.seed)
    table = Table(world, branches, look, rng)
    left, low, right, top = world.bounds.bounds
    place, axes, focal = camera_of(look, (left - 52.0, low - 52.0, right + 52.0, top + 52.0))
    width, height = look.pixels
    u, v = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    image = looked_at(table, place, rays_of(u, v, axes, focal, look))
    image = image.reshape(height, width, 3)
    dim = 1.0 - 0.2 * ((u / width * 2) ** 2 + (v / height * 2) ** 2) / 2
    return developed(image * dim[..., None], look, rng)


def rays_of(u, v, axes, focal, look):
    """Return directions of pixels; the lens bends what lies far from its middle."""
    u, v = np.asarray(u, dtype=float).ravel(), np.asarray(v, dtype=float).ravel()
    half = math.hypot(*look.pixels) / 2
    swell = 1.0 + look.bend * (u**2 + v**2) / half**2
    return np.column_stack([u * swell / focal, v * swell / focal, np.ones_like(u)]) @ axes


def camera_of(look, box_mm):
    left, low, right, top = box_mm
    middle = np.array([(left + right) / 2, (low + top) / 2, 0.0])
    tilt, turn, roll = (math.radians(a) for a in (look.tilt_deg, look.turn_deg, look.roll_deg))
    away = np.array([math.cos(turn), math.sin(turn), 0.0])
    place = middle + look.distance_mm * (math.sin(tilt) * away + [0.0, 0.0, math.cos(tilt)])
    forward = (middle - place) / np.linalg.norm(middle - place)
    axes = axes_of(forward, -away, roll)
    corners = np.array([(x, y, 0.0) for x in (left, right) for y in (low, top)]) - place
    seen = (corners @ axes.T)[:, :2] / (corners @ axes.T)[:, 2:]
    focal = 0.94 / 2 * (np.array(look.pixels) / np.abs(seen).max(axis=0)).min()
    return place, axes, focal


class Table(Raster):
    """Heights, colours and light over a raster of the table."""

    def __init__(self, world, branches, look, rng):
        super().__init__(world, RIM_MM)
        self.look, self.lamp = look, lamp_of(look)
        gx, gy = np.meshgrid(self.x, self.y)
        self.wave = look.wave_mm * np.sin(gx / 41.0 + rng.uniform(0, 6)) * np.sin(gy / 53.0)
        self.height = np.where(self.block, look.height_mm, 0.0)
        layers = [self.tube(branch, rng) for branch in branches if len(branch.points_mm)]
        self.paint_floor(world, rng)
        for where, *layer in layers:
            self.paint_film(where, *layer)
        self.top = float(self.height.max())

    def tube(self, branch, rng):
        """Return where a branch's film lies, how high, and how light falls on it."""
        look, radius = self.look, branch.radius_mm
        line = shapely.segmentize(shapely.LineString(branch.points_mm), 0.5)
        dense = shapely.get_coordinates(line)
        reach = 1.15 * radius + look.seam_mm + 1.0
        lo = ((dense.min(axis=0) - reach - self.low_mm) / CELL_MM).astype(int).clip(0)
        hi = ((dense.max(axis=0) + reach - self.low_mm) / CELL_MM).astype(int) + 2
        box = slice(lo[1], hi[1]), slice(lo[0], hi[0])
        gx, gy = np.meshgrid(self.x[box[1]], self.y[box[0]])
        away, near = cKDTree(dense).query(
            np.column_stack([gx.ravel(), gy.ravel()]), distance_upper_bound=reach
        )
        inside = np.isfinite(away)
        near = np.where(inside, near, 0)
        folds = ndimage.gaussian_filter1d(rng.normal(0.0, 1.0, len(dense)), 5.0)
        folds = folds / max(folds.std(), 1e-9)
        fine = ndimage.gaussian_filter1d(rng.normal(0.0, 1.0, (3, len(dense))), 2.0, axis=1)
        fine = fine / np.maximum(fine.std(axis=1, keepdims=True), 1e-9)
        round_mm = radius * (1.0 + look.wrinkle * folds[near])
        flat_mm = round_mm + look.seam_mm * (0.75 + 0.25 * np.clip(fine[0][near], -1, 1))
        on = inside & (away <= flat_mm)
        out = np.clip(away / round_mm, 0.0, 1.0)
        rise = np.where(away <= round_mm, round_mm * (1 + np.sqrt(1 - out**2)), radius)
        ways = np.column_stack([gx.ravel(), gy.ravel()]) - dense[near]
        ways = ways / np.maximum(np.hypot(*ways.T), 1e-9)[:, None]
        along = np.gradient(dense, axis=0)
        along = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
        tilt = 12.0 * look.wrinkle * (fine[1][near] + 0.7 * fine[2][near] * (2 * out - 1))
        flat = away > round_mm
        normal = np.column_stack([
            out[:, None] * ways + tilt[:, None] * along[near], np.sqrt(1 - out**2) + 0.05
        ])  # fmt: skip
        normal[flat] = (0.0, 0.0, 1.0)
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        face = np.clip(normal @ self.lamp, 0.0, 1.0)
        shine = np.clip(normal @ halfway(self.lamp), 0.0, 1.0) ** 60
        # Light goes a longer way through the sides of a tube, and through one sheet in a seam.
        layers = np.where(flat, 1.4, 2.0 / np.sqrt(1.02 - out**2).clip(0.4))
        cover = 1.0 - (1.0 - look.opacity) ** (layers / 2.0)
        numbers = np.arange(self.height.size).reshape(self.shape)
        cells = numbers[box].ravel()[on]
        height = self.height.reshape(-1)
        below = np.where(self.block.reshape(-1)[cells], 0.0, height[cells])
        lifted = np.where(below > 0.0, np.maximum(below + 0.4, rise[on]), rise[on])
        kept = ~self.block.reshape(-1)[cells]
        height[cells[kept]] = lifted[kept]
        return cells[kept], face[on][kept], shine[on][kept], cover[on][kept]

    def paint_floor(self, world, rng):
        look = self.look
        rows, columns = self.shape
        coarse = ndimage.zoom(
            rng.normal(0, 1, (7, 7)), (rows / 7 + 0.1, columns / 7 + 0.1), order=3
        )
        grain = ndimage.gaussian_filter(rng.normal(0, 1, self.shape), (0.6, 6.0)) * 0.25
        light = 1.0 + 0.07 * coarse[:rows, :columns] + 0.05 * grain
        shadow = shadow_of(self.height, self.lamp, 1.0)
        self.light = 1.0 - (1.0 - look.shade) * ndimage.gaussian_filter(shadow.astype(float), 0.8)
        self.colour = (light * self.light)[..., None] * linear(look.board)
        for marker in corner_markers(world):
            column, row, white = marker_cells(marker, *np.meshgrid(self.x, self.y))
            near = (column >= -1) & (column <= 6) & (row >= -1) & (row <= 6)
            paper = np.where(white, 0.8, 0.02)
            self.colour[near] = (paper * self.light)[near][:, None]
        self.colour[self.block] = linear(look.block) * 0.95

    def paint_film(self, cells, face, shine, cover):
        """Paint a layer of film: part of what lies below shines through, tinted."""
        colour = self.colour.reshape(-1, 3)
        film = linear(self.look.film)
        lit = self.light.reshape(-1)[cells]
        own = (0.25 + 0.25 * lit + 0.55 * face * np.maximum(lit, 0.35))[:, None] * film
        through = colour[cells] * (0.35 + 0.65 * film / film.max())
        mixed = cover[:, None] * own + (1.0 - cover[:, None]) * through
        colour[cells] = mixed + (0.45 * shine * lit)[:, None]


def looked_at(table, place, rays):
    """Return the colours that rays meet: the first thing from above that is as high as they are."""
    lean = rays[:, :2] / rays[:, 2:]
    flat = place[:2] - lean * place[2]
    flat = flat + lean * table.wave.reshape(-1)[table.cells(flat)][:, None]
    height, colour = table.height.reshape(-1), table.colour.reshape(-1, 3)
    block = table.block.reshape(-1)
    ground = bilinear(table, flat)
    reach = int(2 * table.top * np.abs(lean).max() / CELL_MM) | 1
    tall = ndimage.maximum_filter(table.height, size=max(3, reach)).reshape(-1)
    alive = np.flatnonzero(tall[table.cells(flat)] > 0.0)
    entered = np.zeros(len(flat), bool)
    for z in np.arange(table.top, 0.0, -0.4):
        cell = table.cells(flat[alive] + lean[alive] * z)
        hit = height[cell] >= z
        # What is met far below its top is the side of an obstacle.
        is_side = hit & block[cell] & (z < table.look.height_mm - 0.5)
        ground[alive[hit]] = colour[cell[hit]]
        ground[alive[is_side]] *= 0.5
        entered[alive[hit]] = True
        alive = alive[~hit]
    return ground


def bilinear(table, at):
    column = (at[:, 0] - table.low_mm[0]) / CELL_MM - 0.5
    row = (at[:, 1] - table.low_mm[1]) / CELL_MM - 0.5
    return np.stack(
        [
            ndimage.map_coordinates(table.colour[..., k], [row, column], order=1, mode="nearest")
            for k in range(3)
        ],
        axis=-1,
    )
