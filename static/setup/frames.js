// The frames of the box in a setup draft, with the instruments in view, and the marks on them.
import { asProblem } from '../data.js';
import { Problem } from '../api.js';
import { t } from '../texts.js';
import { displayable, pictureOf } from './pictures.js';

/** As many as the service checks at once. */
export const MAX_FRAMES = 8;
let lastMark = 0;

/**
 * Adds pictures: chosen files, or blobs of a camera or a recording. Calls back with the problem of each that cannot be
 * used.
 */
export async function addFrames(draft, pictures, onProblem) {
  for (const picture of pictures) {
    try {
      if (draft.frames.length >= MAX_FRAMES) throw full();
      const shown = await readPicture(picture);
      const number = 1 + Math.max(-1, ...draft.frames.map(frame => frame.number));
      draft.frames = [...draft.frames, { number, ...shown, marks: [] }];
      draft.notify();
    } catch (error) {
      onProblem(asProblem(error));
    }
  }
}

/** A chosen file, or a blob of a camera or a recording, as `{ blob, url, width, height }`. */
export async function readPicture(picture) {
  const { blob } = picture instanceof File ? await pictureOf(picture) : { blob: picture };
  const preview = await displayable(blob);
  if (!preview.width) throw unreadable(picture.name);
  return { blob, ...preview };
}

export function removeFrame(draft, frame) {
  URL.revokeObjectURL(frame.url);
  draft.frames = draft.frames.filter(({ number }) => number !== frame.number);
  draft.notify();
}

/** Adds `rectangles` of one label, painted in one stroke. */
export function addMark(draft, number, label, rectangles) {
  if (rectangles.length === 0) return;
  changeMarks(draft, number, marks => [...marks, { id: ++lastMark, label, rectangles }]);
}

export const undoMark = (draft, number) => changeMarks(draft, number, marks => marks.slice(0, -1));
export const clearMarks = (draft, number) => changeMarks(draft, number, () => []);

function changeMarks(draft, number, change) {
  draft.frames = draft.frames.map(frame =>
    frame.number === number ? { ...frame, marks: change(frame.marks) } : frame,
  );
  draft.notify();
}

const full = () => new Problem({ title: t.setup.colours.full(MAX_FRAMES), status: 0, detail: t.setup.colours.fullBody });
const unreadable = name => new Problem({ title: t.setup.notAPicture(name), status: 0, detail: t.setup.notAPictureBody });
