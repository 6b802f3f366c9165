// Types of the page that no table declares: the state around them, the parts of the page, and the
// answers of the server, which `test_types.py` compares with those that the server gives.

type Place = [x: number, y: number];
type Box = [x: number, y: number, width: number, height: number];

// ---- the state

type Pose = { x_mm: number; y_mm: number; heading_deg: number };

/** A file, or a seed of an environment. */
type MapSource = { file?: string; environment?: string; seed?: number; options?: Record<string, unknown>; stamp?: string };

type MapEdit =
  | ["move", index: number, dx_mm: number, dy_mm: number]
  | ["place", index: number, frame: Partial<Frame>]
  | ["add", corners_mm: Place[]]
  | ["remove", index: number];

type MapTarget = Omit<Target, "tolerance_mm"> & { name: string; tolerance_mm?: number };
type OpenMap = { source: MapSource; edits: MapEdit[]; targets?: MapTarget[] };

type StudioState = {
  design: Design;
  map: OpenMap | null;
  pose: Pose | null;
  recipe: string | null;
  recipe_stamp?: string;
  task: string;
  family: Partial<Family>;
  growth: Partial<GrowthOptions>;
  locks: string[];
  opened?: string;
};

// ---- controls: rows of a form, as `design_form` makes them of declared keys

type RowKind = {
  rows?: undefined; many?: undefined; choices?: undefined; flag?: undefined; slider?: undefined; default?: unknown;
  first?: undefined; absent?: undefined;
};
type Row<T> = { key: string; label: string; about: string } & T & Omit<RowKind, keyof T>;
type TableRow = Row<{ rows: FormRow[]; many: boolean }>;
type ChoiceRow = Row<{ choices: string[]; default: string | null }>;
type FlagRow = Row<{ flag: true; default: boolean }>;
type NumberRow = Row<{
  unit: string; least: number | null; most: number | null; slider: number[]; step: number; whole: boolean; default: number | null;
  /** The first level that has an entry in this list of the build. */
  first?: number;
  absent?: number | null;
}>;
type FormRow = TableRow | ChoiceRow | FlagRow | NumberRow;
type Form = { most_levels: number; rows: FormRow[]; bend: FormRow[] };

/** A number row with its whole key; of a list, also the list's. */
type ValueRow = NumberRow & { list?: NumberRow & { first: number } };
/** Where the values of rows stand in the state. */
type ValueTree = {
  valueOf(state: StudioState, row: ValueRow): unknown;
  write(state: StudioState, row: ValueRow, value: unknown): void;
};
/** Elements, and how to show a state in them. */
type Part = { box: Element; show(state: StudioState): void };
type Drag = { group(key: string): string; moved(event: Event): void };

// ---- elements

type Leaf = Node | string | null | undefined;
type Child = Leaf | Leaf[];
type Listeners<E> = { [K in keyof E & string as `on${K}`]?: (event: E[K] & { currentTarget: Element }) => unknown };
type Attributes<E> = Listeners<E> & { [name: string]: unknown };

// ---- parts of the page

type Step = { state: StudioState; label: string };
type Follow = (state: StudioState, before: StudioState) => void;

/** What a question fails with: its words, or that a newer one took its place or that it was stopped. */
type Failure = { message?: string; stale?: boolean; stopped?: boolean };
type Reject = (failure: Failure) => void;
type Progress = (share: number | null, text: string) => void;
type Asked = { seq: number; ask: object; state: StudioState; resolve(found: unknown): void; reject: Reject };
type Slot = { flight: Asked | null; waiting: Asked | null };

type Reply = { seq: number; answer?: unknown; error?: Failure; progress?: Parameters<Progress> };
type PanelReply = Reply & { event?: undefined; panel: Panel };
type RequestReply = Reply & { event?: undefined; request: RequestName };
type Message = Events[keyof Events] | PanelReply | RequestReply;

type Store = ReturnType<typeof import("studio/store.js").createStore>;
type Connection = ReturnType<typeof import("studio/connection.js").createConnection>;
type View = ReturnType<typeof import("studio/view.js").createView>;

/** What parts of the page listen to, by name: events of the server, and each other. */
type Heard = Events & { preview: Design | null; highlight: string[]; reference: null; branch: string | null };
type Found = { [P in Panel]: { answer: Answers[P]; state: StudioState } };

/** What every panel is mounted with. */
type App = {
  store: Store;
  answers: KeptAnswers;
  hello: Hello;
  live: boolean;
  file: OpenFile;
  /** The design that is shown in place of the one that is open. */
  previewed: Design | null;
  /** The last answer to the design that is open. */
  present: LiveAnswer | null;
  /** The branch that is chosen: its name, or its id where the design has levels. */
  branch: string | null;
  reference: Version | null;
  showGhost: boolean;
  restored: boolean;
  timings: number[];
  remember(): void;
  /** Write the open map into its file, or into a new one. */
  saveMap(): Promise<void>;
  say(text: string, kind?: "info" | "error"): void;
  fail(thrown: unknown, about?: string): void;
  ask<P extends Panel>(panel: P, ask?: object, options?: { state?: StudioState }): Promise<Answers[P]>;
  /** Do something during which questions of some panels are answered without the server: it has sent the answers with another one. */
  knowing(answered: Partial<Answers>, fn: () => void): void;
  cancel(panel: Panel): void;
  onProgress(panel: Panel, fn: Progress): void;
  request<Q extends RequestName>(name: Q, ask?: object): Promise<RequestAnswers[Q]>;
  on<N extends keyof Heard>(name: N, fn: (value: Heard[N]) => void): void;
  take(message: Events[keyof Events]): void;
  onAnswer<P extends Panel>(panel: P, fn: (answer: Answers[P], state: StudioState) => void): void;
  shown(): StudioState;
  preview(design: Design | null): void;
  onPreview(fn: (design: Design | null) => void): void;
  highlight(branches: string[]): void;
  onHighlight(fn: (branches: string[]) => void): void;
  setReference(reference: Version | null): void;
  onReference(fn: () => void): void;
  chooseBranch(label: string | null): void;
  onBranch(fn: (label: string | null) => void): void;
  edits: BranchEdits;
};

/** Events of the window: a step of a drag, its end, new fields of a branch, another tab. */
interface WindowEventMap {
  moved: CustomEvent<number>;
  released: CustomEvent<null>;
  built: CustomEvent<null>;
  tabshown: CustomEvent<string>;
}

/** What a reload of a tab finds of itself. */
type Kept = { started: string; state: StudioState; file: OpenFile; history: { past: Step[]; future: Step[] } };

/** The page, for the console and for tests. */
declare var studio: App;

/** The kinds of change that a fix can leave out. */
type Keep = "branches" | "length" | "angle" | "width";

// ---- many maps

/** One map of the family on the page: its elements, and what is drawn of it. */
type Tile = {
  entry: FamilyMap; item: HTMLElement; button: HTMLButtonElement; value: HTMLElement; difference: HTMLElement;
  ground: Element; robot: Element; drawn: { ground?: string; robot?: string };
};
/** Scores by the maps' keys. */
type Scores = Record<string, number>;

// ---- searches

type ShownFront = Front & { folder: string };
type ChosenPoint = { point: FrontPoint; design: Design; words: string };

// ---- files

type Kind = "design" | "map" | "environment" | "recipe";
/** What can be opened: its name, and where it is or what it is about. */
type Openable = { name: string; path?: string; where?: string; about?: string };
type Note = "disk" | "map" | "unsaved" | "other";
type NoteActions = [label: string, act: () => unknown][];

// ---- exports

/** An option, named as the command calls it; without a kind it is a checkbox. */
type ExportOption = {
  key: string; label: string; kind?: "number" | "select" | "text"; value?: string | number; least?: number; most?: number;
  choices?(state: StudioState): string[];
  /** Whether it is shown. */
  when?(found: CommandsAnswer): boolean;
};
type ExportEntry = { name: ExportKind; title: string; about: string; out: string; place: string; note?: string; options: ExportOption[] };
type AskedExport = { out: string; options: Record<string, string | number | boolean> };

// ---- the map

/** What is chosen on the map: an obstacle by its place, a target by its name; nothing is the start. */
type Chosen = { kind: "obstacle"; id: number } | { kind: "target" | "branch"; id: string } | null;
type ThingKind = "start" | "obstacle" | "target" | "branch";

type BranchEdit = "free" | "child" | "remove" | "mirror" | "bend";
/** Where a tip or a bend is to go. */
type TipAsk = { to?: Place; by?: Place; bend?: number; live?: object };
type BranchEdits = {
  tip(branch: string, ask: TipAsk, group?: string): Promise<unknown>;
  edit(name: BranchEdit, branch?: string, to?: Place): Promise<unknown>;
};
/** What a drag has grabbed. */
type Grabbed =
  | { kind: "measure" | "draw" }
  | { kind: "view"; branch?: string }
  | { kind: "base" | "heading"; pose: Pose }
  | { kind: "tip"; branch: string; bend?: number; isBusy: boolean; to: Place | null }
  | { kind: "target"; id: string; from: Place }
  | { kind: "obstacle"; id: number }
  | { kind: "turn" | "size"; id: number; frame: Frame };
type Dragging = Grabbed & { at: Place; drag: number; moved: boolean; matrix: DOMMatrix; edited?: string };
type TipDrag = Extract<Dragging, { kind: "tip" }>;
type ThingValues = Record<string, unknown> | null | undefined;

/** A design that others are compared with, and what was answered of it under which conditions. */
type Version = {
  design: Design;
  key: string;
  state: StudioState;
  answers: Partial<Compared>;
  conditions: Partial<Record<keyof Compared, string>>;
};
type Compared = Pick<Answers, "live" | "rules" | "family">;

/** A number that versions are compared in: where it comes from, whether more or less of it is better, how it is written. */
type Measure = {
  key: string; name: string; group: string; panel: keyof Compared; better: number; digits: number; unit: string; title: string; note?: string;
  of(found: Partial<Compared>): number | null | undefined;
  isUnclear?(found: Partial<Compared>): boolean;
};

type OpenFile = {
  path: string;
  name?: string;
  writable: boolean;
  stamp?: string;
  run_note?: string;
  /** As it was read. */
  text?: string;
  /** None: a copy without a file. */
  saved_design: Design | null;
  dirty: boolean;
};

/** Answers that the page keeps, or that a snapshot has. */
type KeptAnswers = Partial<Answers> & { search?: SearchEvent; reference?: { design: Design; answers: Partial<Compared> } };

type Hello = {
  version: string;
  folder: string;
  form: Form;
  growth_form: (ChoiceRow | FlagRow | NumberRow)[];
  legend: [sign: string, words: string][];
  state: StudioState;
  file: Omit<OpenFile, "saved_design" | "dirty">;
  /** Not in a snapshot. */
  started?: string;
  environments?: string[];
  problem?: string;
};
type Stored = { date: string; hello: Hello; answers: KeptAnswers };

type Events = {
  hello: { event: "hello" } & Hello;
  again: { event: "again" } & Hello;
  engine: { event: "engine"; engine: string };
  file_changed: FileChange & { event: "file_changed" };
  search: SearchEvent;
};

// ---- answers of panels, by their names

type Answers = {
  live: LiveAnswer;
  before: LiveAnswer;
  front: { front_mm: number; full_mm: number; robot_svg: string };
  tip: { key: string; values: { length?: number; angle_deg?: number; bends?: number[][] }; bend?: number; live?: LiveAnswer };
  edit: { design: Design; branch: string | null };
  cut: { cut: Record<string, CutNote>; outline_svg: string; outline_box: number[] | null };
  inflated: { svg: string; box: number[]; blocks: Block[] };
  rules: RulesAnswer;
  fix: FixAnswer;
  family: FamilyAnswer;
  width: { text: string; blocks: Block[] };
  export: ExportAnswer;
};

/** A block of a result's view, as vinefab.core.view.plain_blocks gives it. */
type Block =
  | { kind: "answer"; text: string; tone: Tone }
  | { kind: "text"; text: string }
  | { kind: "remark"; weight: string; text: string; more: string[] }
  | { kind: "facts"; rows: string[][] }
  | { kind: "table"; caption: string; headings: string[]; rows: string[][] };

type GrowthValues = Omit<GrowthOptions, "contacts"> & { contacts: MeasuredContacts | null };

type LiveAnswer = {
  engine: string;
  growth: { values: GrowthValues; usual: GrowthValues; trained: boolean; text: string };
  /** The names of the branches by their ids; empty where the design has levels. */
  names: Record<string, string>;
  branch: ChosenBranch | null;
  ground_key: string;
  facts: {
    branches: number; text: string;
    deployed?: number; grown_mm?: number; planned_mm?: number; pressure_needed_kpa?: number | null;
  };
  // where a map is open
  ground_svg?: string | null;
  view_box?: string;
  targets?: TargetFound[];
  targets_svg?: string;
  /** The map before the page changes it. */
  source?: SourceFound;
  obstacle?: { index: number; frame: Frame; path: string; svg: string } | null;
  // where the map has a start
  pose?: Pose;
  pose_svg?: string;
  // where something grows
  targets_headline?: string;
  targets_tone?: string;
  robot_svg?: string;
  front_full_mm?: number;
  scores?: Record<string, number | null>;
  titles?: Record<string, string>;
  unscored?: string[];
  problems?: string[];
  /** The page's mark of scores that are those before. */
  isUnscored?: boolean;
};

/** The branch that is chosen: its values in force, what became of it, handles of its bends. */
type ChosenBranch = { label: string; level: number; values: Record<string, number>; text: string; svg: string };

type SourceFound = { pose: Pose | null; targets: TargetFound[]; obstacles: number };

/** A target, and where something grows how near the robot came. */
type TargetFound = Target & {
  name: string; state?: string; touched?: boolean; missed_mm?: number | null; branch?: string | null; share?: number; deployments?: number;
};

type CutNote = { kind: string; text: string; about: string };

type Finding = {
  rule: string; title: string; reason: string; severity: Severity; message: string;
  measured: number | null; limit: number | null; unit: string; branches: string[]; names: string[]; at_mm: number[] | null; marker: string;
  fingerprint: string; waived: boolean; waiver_reason: string;
};

type CheckReport = {
  verdict: string; manufacturable: boolean; errors: number; warnings: number; rules_run: number;
  notes: { rule: string; note: string }[];
  rules_skipped: { rule: string; reason: string }[];
  stale_waivers: string[];
};

type Need = { kpa: number; branch: string; place: string };
type Gauge = {
  needed_loose: Need; needed_tight: Need; needed_standing: string; needed_basis: string;
  working_kpa: number; working_standing: string;
  allowed_kpa: number; allowed_standing: string; allowed_basis: string;
  is_open: boolean; is_open_tight: boolean;
};
type BillLine = { item: string; value: number; unit: string; standing: string; basis: string };

type RulesAnswer = CheckReport & {
  sheet_svg: string; beds_svg: string; sheet_box: Box | null;
  placement: { rotation_deg: number; dx_mm: number; dy_mm: number } | null;
  findings: Finding[]; findings_left_out: number; signs: Record<Severity, string>;
  pieces: number; pieces_words: string; sheets: number; tiles: number;
  gauge: Gauge;
  bill: BillLine[];
  deployed: string[]; deployed_problem: string;
  cut: Record<string, CutNote>;
};

type FixAnswer = {
  lines: string[];
  changes: string[];
  design: Design | null;
  locks_changed?: string[];
  keep: string[]; keep_words: string[];
  scores: { task: string; before: number; after: number }[]; scores_note: string;
};

type FamilyMap = {
  key: string; name: string; source: MapSource; view_box: string;
  ground_svg: string | null; robot_svg: string | null; score: number | null;
  // once it is evaluated
  scores?: number[]; pose?: Pose; grown_share?: number; branches?: number; deployed?: number;
};
type Spread = { maps: number; mean: number; low: number | null; high: number | null };
type Difference = Spread & { better: number; worse: number };
type Heat = {
  low_mm: number[]; cell_mm: number; columns: number; rows: number; share: string; most: number; maps: number;
  same_size: boolean; colours: string[];
};
type FamilyAnswer = {
  task: string; title: string; poses: number; standing: string; quick: boolean; compiling: string | null;
  maps: FamilyMap[]; evaluated: number; environments: string[];
  distribution: Spread & {
    quantiles: Record<string, number>;
    bins: { low: number; step: number; counts: number[]; before: number[] };
  };
  difference: Difference | null;
  grown_share: number;
  heat: Heat | null;
  /** The page's mark of what the scores depend on beside the design. */
  conditions?: string;
};

/** What is known of each export before it is written. */
type CommandsAnswer = { commands: Partial<Record<ExportKind, { command?: string; inputs?: string[]; error?: string }>>; unverified: boolean };
type WrittenAnswer = {
  command: string; written: string[]; inputs: string[]; view: Block[]; refused: string;
  findings?: WrittenFinding[];
};
type WrittenFinding = {
  id: string; severity: Severity; title: string; message: string; measured: number | null; limit: number | null; unit: string;
  branches: string[]; names: string[]; x_mm: number | null; y_mm: number | null; marker_wkt: string; fingerprint: string; waived: boolean; reason: string;
};
type ExportAnswer = CommandsAnswer | WrittenAnswer;

// ---- answers to requests, by their names

type RequestAnswers = {
  choices: {
    designs: Choice[]; maps: Choice[]; recipes: Choice[]; folders: string[]; complete: boolean;
    environments: { name: string; about: string; options: Record<string, unknown> }[];
  };
  open_design: {
    design: Design; path: string; name: string; writable: boolean; stamp: string; text: string;
    task?: string; recipe?: string; run_note?: string;
  };
  open_map: { source: MapSource; name: string; obstacles: number; starts: number; stamp: string };
  open_recipe: { recipe: string; title: string };
  save_design: Saved | Conflict;
  save_map: { saved: true; path: string; stamp: string; source: MapSource } | Conflict;
  keep_autosave: { kept: string };
  autosaves: { autosaves: Autosave[] };
  open_autosave: { key: string; kept_at: string; state: StudioState; file: KeptFile | null; left: string[] };
  drop_autosave: Record<string, never>;
  search_propose: Proposal;
  search_start: BegunSearch;
  search_stop: { folder: string; state: string };
  search_resume: BegunSearch;
  search_runs: { runs: ListedRun[]; left_out: number; is_whole: boolean; search: SearchEvent | null; home: string };
  search_load: { design: Design; folder: string; point: string; words: string };
  search_front: { folder: string; front: Front };
};

type Choice = { name: string; path: string; where: string };
type Saved = { saved: true; path: string; stamp: string; text: string; writable: boolean; note: string };
type FileChange = { kind: "design" | "map" | "recipe"; path: string; stamp: string; design: Design | null; problem: string | null };
type Conflict = Omit<FileChange, "kind"> & { saved: false; why: string };
type KeptFile = { path?: string | null; name?: string; stamp?: string };
/** Unsaved work; `left` are files that it was made with and that are not open here. */
type Autosave = {
  key: string; kept_at: string; name: string | null; design: Design | null; map: OpenMap | null; file: KeptFile | null; left: string[];
};
type BegunSearch = { folder: string; command: string; state: string };

type Objective = { name: string; unit: string; better: string; kind: string };
type FrontPoint = { point: string; label: string; values: number[]; breaks: boolean };
type Front = { objectives: Objective[]; points: FrontPoint[]; is_final: boolean };
type RunState = "running" | "ended" | "stopped" | "failed" | "unfinished" | "unreadable";

type SearchEvent = {
  event: "search"; folder: string; state: RunState; share: number; generations: number;
  evaluations: number; task: string | null; curve: number[][]; best: Design | null; best_score: number | null;
  /** How many targets are touched, as everywhere; empty without targets. */
  best_touched: string;
  best_words: string; front: Front | null; line: string; command: string;
};

type ListedRun = {
  folder: string; state: RunState; line: string;
  name?: string; task?: string; objectives?: string[]; generations?: number; most_generations?: number;
  best_score?: number | null; best_touched?: string; best_words?: string;
};

type SearchValue = {
  key: string; level: number; label: string; unit: string; value: number; range: number[]; limits: number[]; locked: boolean; whole: boolean;
};
type Proposal = {
  folder: string; command: string; values: SearchValue[]; levels: number[]; most_levels: number;
  deeper: Record<string, [low: number, high: number, unit: string]>;
  notes: string[]; tasks: string[]; objectives: { name: string; kind: string; words: string }[]; optimizers: string[]; environments: string[];
  has_map: boolean; has_targets: boolean; must_be_free: boolean;
  settings: {
    task: string; objectives: string[]; maps: { environment: string; count: number; seed: number; shown: boolean }; fabricable: boolean;
    population: number; generations: number; optimizer: string; seed: number; start_here: boolean; free: boolean; only: string | null;
  };
};
