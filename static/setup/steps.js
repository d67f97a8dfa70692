// The steps of setting up a box, in order, and how each stands. `done`, `todo`, `again` (look again), `free` (if wanted).
import { entryOf } from './marks.js';
import { goodPhotos } from './photos.js';
import { needsOf } from './needs.js';

/** Beyond this the quality gate marks every session of the box, pixels. */
const MOST_RMS_PX = 1;

export const STEPS = ['board', 'photos', 'calibration', 'tools', 'colours', 'agent', 'test'];

/** Every step's state, from what REST tells of the box and what lies on the bench. */
export function statesOf(box, bench) {
  const { plan, photos } = bench;
  return {
    board: plan.measured || box.camera?.square_mm ? 'done' : 'todo',
    photos: photosState(photos, box),
    calibration: calibrationState(box),
    tools: toolsState(plan.tools, box.tools),
    colours: coloursState(box.palettes[0], plan.tools),
    agent: box.tokens?.length ? 'done' : 'free',
    test: testState(box),
  };
}

/** The first step that waits for somebody; where none does, the first. */
export const nextOf = states => STEPS.find(step => states[step] === 'todo' || states[step] === 'again') ?? STEPS[0];

export const isPoor = rms => Number.isFinite(rms) && rms > MOST_RMS_PX;

/** A tool of the box as this page keeps it. */
export const planned = ({ name, colour, side, diameter_mm, band_length_mm }, index) => ({
  id: index + 1,
  tape: colour ?? name,
  name: colour ? name : '',
  side: side ?? '',
  diameter: diameter_mm,
  band: band_length_mm ?? undefined,
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
  if (planned.length > 0) return planned.every(isWhole) ? 'done' : 'again';
  return known.length > 0 ? 'done' : 'todo';
}

/** Has it what a measurement needs? */
export const isWhole = ({ tape, diameter }) => Boolean(tape?.trim() && diameter > 0);

function coloursState(palette, planned) {
  if (!palette) return 'todo';
  if (isOutdated(planned, palette)) return 'again';
  return (palette.verdicts ?? []).some(({ grade }) => grade === 'bad') ? 'again' : 'done';
}

/** Are the instruments described otherwise than they were when these colours were learned? They are saved with the colours. */
export function isOutdated(planned, palette) {
  if (!palette || planned.length === 0 || !planned.every(isWhole)) return false;
  return alike(planned.map(entryOf)) !== alike(palette.tools.map(({ name, ...rest }) => ({ tool: name, ...rest })));
}

/** The same text for the same instruments, in whatever order. */
const alike = tools =>
  tools.map(of => JSON.stringify([of.tool, of.colour ?? null, of.side ?? null, of.diameter_mm, of.band_length_mm ?? null])).sort().join();

function testState(box) {
  const [test] = box.selfTests;
  if (!test) return 'todo';
  return test.light === 'green' && !isOfOlder(test, box) ? 'done' : 'again';
}

/** Was another camera or were other colours tested than those in use? */
export const isOfOlder = (test, { calibration, palettes }) =>
  test.calibration !== calibration?.id || test.palette !== palettes[0]?.id;
