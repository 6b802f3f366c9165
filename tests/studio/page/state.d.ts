// Written by state_types.py from the declared tables of vinefab: edit those.

type Panel = "live" | "before" | "front" | "tip" | "edit" | "cut" | "inflated" | "rules" | "fix" | "family" | "width" | "export";

type RequestName = "choices" | "open_design" | "open_map" | "open_recipe" | "save_design" | "save_map" | "keep_autosave" | "autosaves" | "open_autosave" | "drop_autosave" | "search_propose" | "search_start" | "search_stop" | "search_resume" | "search_runs" | "search_load" | "search_front";

type ExportKind = "package" | "report" | "rig" | "picture" | "snapshot";

type Severity = "error" | "warning" | "info";

type Tone = "plain" | "good" | "caution" | "bad";

/** Level 1. */
type Trunk = {
  /** mm: of the trunk, times scale_mm_per_unit */
  length: number;
  /** preformed turns, `[mm from the base, degrees counter-clockwise]` each: the tube is cut with them */
  bends?: [number, number][];
};

/** One level of branches; every branch of the level before sprouts the same fan. */
type Level = {
  /** children per parent (SPL of the paper) */
  branches: number;
  /** mm: of the first child (BL), clockwise-most, times scale_mm_per_unit */
  length: number;
  /** deg: the whole fan (theta), first child to last */
  angle_deg: number;
  /** %: last child's length over the first's (LGF) */
  growth_percent: number;
  /** preformed turns, `[mm from the base, degrees counter-clockwise]` each: the tube is cut with them */
  bends?: [number, number][];
};

/** The wider pocket at every leaf tip that jams in a gap (flat sizes, before inflation). */
type Pouch = {
  /** round: a disc; rectangle: along the branch */
  shape: "round" | "rectangle";
  /** mm: of a round one */
  radius_mm?: number;
  /** mm: of a rectangle, along the branch */
  length_mm?: number;
  /** mm: of a rectangle, across it */
  width_mm?: number;
};

/** One branch of a robot that is written branch by branch. */
type Branch = {
  /** unique: letters, digits, `-` and `_` */
  name: string;
  /** name of its parent */
  of?: string;
  /** deg: from the parent's heading at its end, counter-clockwise positive */
  angle_deg: number;
  /** mm: of the branch, times scale_mm_per_unit */
  length: number;
  /** preformed turns, `[mm from the base, degrees counter-clockwise]` each: the tube is cut with them */
  bends?: [number, number][];
  /** mm: lay-flat lumen width at its base; left out: that of its level */
  width_mm?: number;
  /** ×: width at its end over that at its base; left out: that of its level */
  taper?: number;
  /** mm: radius in the joint at its base; left out: that of its level */
  fillet_mm?: number;
  /** at its tip, where it has no children: false for none; left out: that of the build */
  pouch?: boolean | Pouch;
};

/** The end of the tail, as wide as the clamp of a base needs. */
type Collar = {
  /** mm: of the pipe that the mouth is pulled over */
  clamp_diameter_mm: number;
  /** mm: of the straight part at the mouth; 0: the flare ends there */
  length_mm: number;
  /** mm: over which the width changes to that of the tail */
  flare_mm: number;
};

/** How a robot may be cut in flat pieces, which sleeves join. */
type PieceSettings = {
  /** pieces: pieces that may be cut; the fewest that the tree needs are */
  most: number;
  /** mm: that socket and plug lie on each other, along the branch (assumed) */
  lap_mm: number;
  /** mm: added to the flat width of a socket (assumed) */
  ease_mm: number;
};

/** How a tree of lines becomes a flat tube. */
type Build = {
  /** mm: lay-flat lumen width where a level's branches begin, trunk first; inflates to 2 w/pi */
  widths_mm: number[];
  /** mm: in place of widths_mm, with width_ratio; 40 if left out */
  trunk_width_mm?: number;
  /** in place of widths_mm: of a level over the one before; 0.6 if left out */
  width_ratio?: number;
  /** ×: width at the end of each level's branches over that at their beginning */
  taper: number[];
  /** mm: radius in each level's joints, level 2 first */
  fillet_mm: number[];
  /** in place of fillet_mm: radius over the child's width; 0.25 if left out */
  fillet_ratio?: number;
  /** mm: below the trunk, inverted over the base and clamped */
  tail_mm: number;
  /** kPa: working gauge pressure; 0: not known */
  pressure_kpa: number;
  /** at the tip of every leaf; left out: rounded tips */
  pouch?: Pouch;
  /** fits the tail to a clamp */
  collar?: Collar;
  /** may be cut in flat pieces, joined by sleeves; left out: one outline */
  pieces?: PieceSettings;
  /** inflation: cut with the flat angles and lengths that deploy as designed (simulated); none: cut as designed, and grown as that deploys */
  compensation?: "inflation" | "none";
  /** tail_inverted: mounted as cut, faces inside end outside; turned: first turned inside out */
  mounting?: "tail_inverted" | "turned";
};

/** A finding that the designer accepts. */
type Waiver = {
  /** of the finding, as `vinefab check` shows it */
  fingerprint: string;
  /** why it is accepted; stands in every report */
  reason: string;
};

/** A branching vine robot, lengths in millimetres. */
type Design = {
  /** kind of file and its version */
  schema: "vinefab/design-1";
  /** in reports, on the sheet and of files: letters, digits, `_-.` */
  name: string;
  /** multiplies lengths of trunk and levels */
  scale_mm_per_unit: number;
  /** level 1 */
  trunk: Trunk;
  /** one per level after the trunk; none: a plain vine */
  level: Level[];
  /** every branch after the trunk, in any order; in place of levels */
  branch?: Branch[];
  /** how it is made */
  build: Build;
  /** findings that are accepted */
  waive: Waiver[];
  /** limits of rules for this design, in place of the recipe's: `[limits.VF-C01] warning = 6.0` */
  limits: Record<string, Record<string, number>>;
  /** how the design was made, free-form; written by `vinefab optimize`: commands use the task, growth options and recipe of its run */
  origin: Record<string, unknown>;
};

/** A number with its 95 % interval and its sample; its unit is in its name. */
type MeasuredNumber = {
  /** of the 95 % interval */
  low: number;
  /** of the 95 % interval */
  high: number;
  /** the most likely one; left out where only a bound is known */
  value?: number;
  /** both: an interval; lower or upper: only that bound is known */
  side?: "both" | "upper" | "lower";
  /** of contacts or places that it rests on */
  count: number;
  /** that they were seen on */
  photos: number;
  /** which photos, and how */
  source: string;
  /** always that */
  standing?: "measured";
};

/** A share of trials with its 95 % interval. */
type MeasuredShare = {
  /** of the 95 % interval */
  low: number;
  /** of the 95 % interval */
  high: number;
  /** that came out */
  count: number;
  /** that were tried */
  tried: number;
  /** kPa: at which they were tried */
  pressure_kpa: number;
  /** which coupons, and how */
  source: string;
  /** always that */
  standing?: "measured";
};

/** The head-on half-angle on one surface: the likely value, and the range that it lies in. */
type SurfaceAngle = {
  /** deg: least; 0 where every tip grew on */
  low: number;
  /** deg: greatest; 90 where every tip stopped */
  high: number;
  /** deg: the most likely one; left out where it is not known */
  value?: number;
};

/** Contacts with one kind of wall: the half-angle belongs to a surface with a film. */
type Surface = {
  /** its name */
  surface: string;
  /** deg: within it of a wall's normal, head-on, a tip stops */
  half_angle_deg: SurfaceAngle;
  /** that were seen; 0: no count is published */
  contacts: number;
  /** mm: of the tubes; left out: not known */
  tube_diameter_mm?: number;
  /** of the tubes */
  film?: string;
  /** who saw them, and how */
  source: string;
  /** where the half-angle comes from */
  standing?: "measured" | "published" | "assumed";
};

/** What was measured of contacts: a number that was not is None. */
type MeasuredContacts = {
  /** deg: within it of a wall's normal, head-on, a tip stops */
  head_on_half_angle_deg?: MeasuredNumber;
  /** of the everting tip on the wall: tangent of the half-angle */
  tip_friction?: MeasuredNumber;
  /** how far centre lines keep from walls that bodies touch, over lay-flat width / pi */
  body_width_ratio?: MeasuredNumber;
  /** breadth of the film as seen from above, over 2 lay-flat width / pi */
  film_breadth_ratio?: MeasuredNumber;
  /** share of the children that come out of their parent's tip */
  emergence?: MeasuredShare;
  /** half-angles by surface, which maps and rigs name */
  surfaces: Surface[];
};

/** Options of the growth model; recorded with every result, because results depend on them. */
type GrowthOptions = {
  /** deg: within it of head-on a tip stops, 0 to 90; [low, high]: drawn */
  head_on_half_angle_deg: number | [number, number];
  /** of a branch that stopped early: they stay inside, or grow from where it stopped */
  children_of_stuck?: "stop" | "deploy";
  /** inflated, or a line as in the paper */
  body?: "inflated" | "centerline";
  /** whether growth ends where the design's pressure no longer everts the film */
  pressure_stop: boolean;
  /** kPa: tension of the film in its store: 0 if it lies loosely, 8.32 on a tight spool */
  storage_kpa: number;
  /** mm: of the tube of the published fit of the growth pressure (assumed) */
  fitted_diameter_mm: number;
  /** of a tip that meets the body of another branch: it stops there, or passes through */
  branch_contact?: "stop" | "pass";
  /** probability that a child comes out of its parent's tip; below 1: drawn */
  emergence: number;
  /** how far bodies keep their centre lines from walls, over lay-flat width / pi */
  body_width_ratio: number;
  /** measured: a file, relative to the run file, or its name; or the numbers themselves */
  contacts?: MeasuredContacts;
  /** of the walls: smooth, rough, or one of `contacts`; else the maps', where they say it */
  surface?: string;
};

/** The maps of the panel with many maps: seeds of an environment, or files. */
type Family = {
  environment?: string;
  count: number;
  /** of the first map; the others follow */
  seed: number;
  /** on each map, drawn from its starts */
  poses: number;
  /** in place of an environment */
  files: string[];
  /** changes when a file has changed */
  stamp?: string;
};

/** The smallest rectangle around an obstacle: what is typed and dragged of it. */
type Frame = {
  /** mm: of its middle */
  x_mm: number;
  /** mm: of its middle */
  y_mm: number;
  /** mm: along its first axis */
  width_mm: number;
  /** mm: across it */
  height_mm: number;
  /** deg: of its first axis from x */
  turn_deg: number;
};

/** A point or an area of a map that a robot is to touch. */
type Target = {
  /** in results; default: A, B, C ... */
  name?: string;
  /** mm: [x, y] of a point */
  point_mm?: [number, number];
  /** mm: corners of an area */
  area_mm?: [number, number][];
  /** mm: largest straight distance of a centreline, walls or not, that counts as touched; default: 20 for a point, 0 for an area (assumed) */
  tolerance_mm: number;
};
