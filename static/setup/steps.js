// The steps of setting up a box, in order, and the state of each: `done`, `todo`, `again` (check again), `free`
// (optional).
import { isBare, toolEntry } from './marks.js';
import { goodPhotos } from './photos.js';
import { needsOf } from './photo_needs.js';

/** Beyond this, the quality gate flags every session of the box, pixels. */
const MAX_RMS_PX = 1;

export const STEPS = ['board', 'photos', 'calibration', 'tools', 'colours', 'agent', 'test'];

/** The state of every step, from the REST API's data on the box and from the draft. */
export function stepStates(box, draft) {
  const { plan, photos } = draft;
  return {
    // New photos are of a board whose squares have to be measured; without any, the camera in use says that they were.
    board: plan.measured || (box.camera?.square_mm && photos.length === 0) ? 'done' : 'todo',
    photos: photosState(photos, box),
    calibration: calibrationState(box),
    tools: toolsState(plan.tools, box.tools),
    colours: coloursState(box.palettes[0], plan.tools),
    agent: box.tokens?.length ? 'done' : 'free',
    test: testState(box),
  };
}

/** The first step that is not done; if all are, the first. */
export const nextStep = states => STEPS.find(step => states[step] === 'todo' || states[step] === 'again') ?? STEPS[0];

export const isPoor = rms => Number.isFinite(rms) && rms > MAX_RMS_PX;

/**
 * A tool of the box as the draft keeps it.
 *
 * @param {Schemas['BoxTool']} tool
 * @param {number} index
 */
export const plannedTool = ({ name, colour, side, diameter_mm, band_length_mm, marker }, index) => ({
  id: index + 1,
  tape: colour ?? name,
  name: colour && !(marker && name === side) ? name : '',
  side: side ?? '',
  diameter: diameter_mm,
  band: band_length_mm ?? undefined,
  marker: marker ?? undefined,
});

function photosState(photos, box) {
  if (photos.length === 0) return box.calibration ? 'done' : 'todo';
  if (needsOf(goodPhotos(photos)).isEnough) return 'done';
  return box.calibration ? 'done' : 'again';
}

function calibrationState({ calibration }) {
  if (!calibration) return 'todo';
  return isPoor(calibration.rms_px) ? 'again' : 'done';
}

function toolsState(planned, known) {
  if (planned.length > 0) return planned.every(isComplete) ? 'done' : 'again';
  return known.length > 0 ? 'done' : 'todo';
}

/** Whether the tool has what a measurement needs. */
export const isComplete = tool =>
  Boolean(tool.tape?.trim() && tool.diameter > 0 && (tool.side || !isBare(tool)) && !hasImpossibleSize(tool));

/** What the service accepts, mm: trocars have 2 to 15 mm, and a band has to show its borders and fit into a box. */
/** @type {[number, number]} */
export const DIAMETER_MM = [2, 15];
/** @type {[number, number]} */
export const BAND_MM = [5, 150];

const isOutside = (value, [min, max]) => Number.isFinite(value) && (value < min || value > max);
const hasImpossibleSize = ({ diameter, band }) => isOutside(diameter, DIAMETER_MM) || isOutside(band, BAND_MM);

function coloursState(palette, planned) {
  if (!palette) return 'todo';
  if (isOutdated(planned, palette)) return 'again';
  return (palette.verdicts ?? []).some(({ grade }) => grade === 'bad') ? 'again' : 'done';
}

/** Whether the instruments differ from those of the learned colours. They are saved with the colours. */
export function isOutdated(planned, palette) {
  if (!palette || planned.length === 0 || !planned.every(isComplete)) return false;
  return signature(planned.map(toolEntry)) !== signature(palette.tools.map(({ name, ...rest }) => ({ tool: name, ...rest })));
}

/** Whether the instruments differ from those of the learned colours in their sizes alone: nothing has to be marked again. */
export const isResized = (planned, palette) =>
  isOutdated(planned, palette) && planned.every(tool => !hasImpossibleSize(tool)) &&
  kinds(planned.map(toolEntry)) === kinds(palette.tools.map(({ name, ...rest }) => ({ tool: name, ...rest })));

/** The same text for instruments that differ in their sizes alone. */
const kinds = tools =>
  tools.map(({ tool, colour, side, marker }) => JSON.stringify([tool, colour ?? null, side ?? null, marker?.kind ?? null])).sort().join();

/** The same text for the same instruments, in any order. */
const signature = tools => tools.map(signatureOf).sort().join();

const signatureOf = ({ tool, colour, side, diameter_mm, band_length_mm, marker }) =>
  JSON.stringify([
    tool,
    colour ?? null,
    side ?? null,
    diameter_mm,
    band_length_mm ?? null,
    marker ? [marker.collar_mm ?? null, marker.jaw_mm ?? null] : null,
  ]);

function testState(box) {
  const [test] = box.selfTests;
  if (!test) return 'todo';
  return test.light === 'green' && !isTestOutdated(test, box) ? 'done' : 'again';
}

/**
 * Whether the test used another camera or other colours than those in use.
 *
 * @param {Schemas['SelfTestResponse']} test
 * @param {Props['box']} box
 */
export const isTestOutdated = (test, { calibration, palettes }) =>
  test.calibration !== calibration?.id || test.palette !== palettes[0]?.id;
