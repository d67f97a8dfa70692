// Frames of the box on a bench, with the instruments in view, and what is marked on them.
import { asProblem } from '../data.js';
import { Problem } from '../api.js';
import { t } from '../texts.js';
import { pictureOf, shown } from './pictures.js';

/** As many as the service looks over at once. */
export const MOST_FRAMES = 8;
let lastMark = 0;

/** Adds pictures: chosen files, or blobs of a camera or a recording. Calls back with what cannot be used. */
export async function addFrames(bench, pictures, onProblem) {
  for (const picture of pictures) {
    try {
      if (bench.frames.length >= MOST_FRAMES) throw full();
      const { blob } = picture instanceof File ? await pictureOf(picture) : { blob: picture };
      const look = await shown(blob);
      if (!look.width) throw unreadable(picture.name);
      const number = 1 + Math.max(-1, ...bench.frames.map(frame => frame.number));
      bench.frames = [...bench.frames, { number, blob, ...look, marks: [] }];
      bench.tell();
    } catch (error) {
      onProblem(asProblem(error));
    }
  }
}

export function removeFrame(bench, frame) {
  URL.revokeObjectURL(frame.url);
  bench.frames = bench.frames.filter(({ number }) => number !== frame.number);
  bench.tell();
}

/** `rectangles` of one label, painted in one go. */
export function mark(bench, number, label, rectangles) {
  if (rectangles.length === 0) return;
  changeMarks(bench, number, marks => [...marks, { id: ++lastMark, label, rectangles }]);
}

export const undo = (bench, number) => changeMarks(bench, number, marks => marks.slice(0, -1));
export const clear = (bench, number) => changeMarks(bench, number, () => []);

function changeMarks(bench, number, change) {
  bench.frames = bench.frames.map(frame =>
    frame.number === number ? { ...frame, marks: change(frame.marks) } : frame,
  );
  bench.tell();
}

const full = () => new Problem({ title: t.setup.colours.full(MOST_FRAMES), status: 0, detail: t.setup.colours.fullBody });
const unreadable = name => new Problem({ title: t.setup.notAPicture(name), status: 0, detail: t.setup.notAPictureBody });
