// What page and process say to each other, made from viewport_messages.py (tests/support/pages/message_types.py).

/** The image that is wanted, in the display's pixels; `again` if it was wanted before the line was cut. */
export interface Size {
  type: "size";
  width: number;
  height: number;
  again: boolean;
}

/** The whole view, of an image of this size; `event` counts the tab's pointer events. */
export interface ViewTurned {
  type: "view";
  rotation: [number, number, number, number];
  zoom: number;
  center: [number, number, number];
  width: number;
  height: number;
  settled: boolean;
  event: number;
}

/** Half-open grid ranges. */
export interface BoundsMoved {
  type: "bounds";
  low: [number, number, number];
  high: [number, number, number];
  settled: boolean;
  event: number;
}

/** What lies under this pixel? If it was `picked` that is to be told wherever the pointer has gone since. */
export interface ProbeAsked {
  type: "probe";
  x: number;
  y: number;
  picked: boolean;
}

/** What lies under this pixel becomes the centre. */
export interface CenterAsked {
  type: "center";
  x: number;
  y: number;
}

/** Take the last change back. */
export interface UndoAsked {
  type: "undo";
}

/** Make it again. */
export interface RedoAsked {
  type: "redo";
}

/** The picture of this number is on the canvas, or dropped. */
export interface PictureShown {
  type: "shown";
  number: number;
}

/** The slices through this voxel are wanted from now on, or none any more. */
export interface SlicesAsked {
  type: "slices";
  at: [number, number, number] | null;
  coloured: boolean;
  longest: number;
}

/** The slice that came last is on its canvas. */
export interface SliceShown {
  type: "slice_shown";
}

/** What is the value of this voxel of a slice? */
export interface VoxelAsked {
  type: "voxel";
  index: [number, number, number];
}

/** What the indices of one grid axis stand for, where that is more than a length: inlines, time, velocity, ... */
export interface GridAxis {
  name: string;
  unit: string;
  first: number;
  step: number;
}

/** What a length in the picture is. */
export interface Scale {
  name: string;
  unit: string;
  length: number;
  axis: number | null;
}

/** The volume as it stands: its grid in upright axes, and what lies on its six sides. */
export interface VolumeTold {
  type: "volume";
  name: string;
  dims: [number, number, number];
  index_to_upright: [[number, number, number], [number, number, number], [number, number, number]];
  reference_spacing: number;
  unit: string;
  sides: Record<string, string>;
  density_name: string;
  strength_name: string;
  value_unit: string;
  axes: [GridAxis, GridAxis, GridAxis] | null;
  scales: (Scale)[];
}

/** A view in numbers. */
export interface ViewShown {
  rotation: [number, number, number, number];
  zoom: number;
  center: [number, number, number];
}

/** Zoom and centre at which what is visible fits. */
export interface Fit {
  zoom: number;
  center: [number, number, number];
}

/** Bounds in numbers. */
export interface BoundsShown {
  low: [number, number, number];
  high: [number, number, number];
}

/** View and bounds in numbers, and once the scene is settled its fit. */
export interface SceneTold {
  type: "scene";
  revision: number;
  by: string;
  settled: boolean;
  view: ViewShown;
  fit: Fit | null;
  bounds: BoundsShown;
  edges: boolean;
  width: number;
  height: number;
}

/** A voxel of the picture. */
export interface ProbedVoxel {
  index: [number, number, number];
  density: number;
  strength: number;
}

/** What lies under the pixel that was asked about, and how its values stand to the file's. */
export interface ProbeAnswered {
  type: "probe";
  x: number;
  y: number;
  found: ProbedVoxel | null;
  density_is: "" | "≈" | "≥" | "≤";
  strength_is: "" | "≈" | "≥" | "≤";
}

/** What the file has where the voxel lies that was found under this pixel, in all its digits. */
export interface FileValueTold {
  type: "value";
  x: number;
  y: number;
  density: string;
  strength: string | null;
}

/** What a slice shows of a voxel. */
export interface VoxelTold {
  type: "voxel";
  index: [number, number, number];
  found: ProbedVoxel | null;
  density_is: "" | "≈" | "≥" | "≤";
  strength_is: "" | "≈" | "≥" | "≤";
}

/** What the file has of a voxel that a slice shows, in all its digits. */
export interface SliceValueTold {
  type: "slice_value";
  index: [number, number, number];
  density: string;
  strength: string | null;
}

/** A line for the person. */
export interface TroubleTold {
  type: "trouble";
  text: string;
  lasting: boolean;
}

/** What is drawn while the picture is looked at. */
export interface NextStep {
  step: "A" | "B" | "C" | "D" | "E" | "F" | "G";
  expected: number | null;
}

/** What goes before a picture: JPEG while things move or refine, PNG for the last. */
export interface PictureHeader {
  number: number;
  revision: number;
  event: number;
  step: "A" | "B" | "C" | "D" | "E" | "F" | "G";
  one_in: number;
  complete: boolean;
  last: boolean;
  seconds: number | null;
  next: NextStep | null;
  width: number;
  height: number;
  view: ViewShown;
  notice: string;
  missing: ([[number, number, number], [number, number, number]])[];
  undrawn: ([number, number, number, number])[];
}

/** What goes before a slice's PNG, in which the earlier of the two other axes runs to the right. */
export interface SliceHeader {
  slice: number;
  index: number;
  step: [number, number];
  missing: boolean;
}

export type PageMessage = Size | ViewTurned | BoundsMoved | ProbeAsked | CenterAsked | UndoAsked | RedoAsked | PictureShown | SlicesAsked | SliceShown | VoxelAsked;

export type ProcessMessage = VolumeTold | SceneTold | ProbeAnswered | FileValueTold | VoxelTold | SliceValueTold | TroubleTold;
