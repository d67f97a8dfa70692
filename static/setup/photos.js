// The photos of the board in a setup draft: the service checks each as soon as it is added.
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { displayable, pictureOf } from './pictures.js';

const MAX_PARALLEL = 2;
let last = 0;

/** Adds chosen files or pictures of the camera; calls back with the problem of a file that is no picture. */
export async function addPhotos(draft, box, files, onProblem) {
  for (const file of files) {
    try {
      const { blob, name } = file instanceof File ? await pictureOf(file) : { blob: file, name: null };
      const id = ++last;
      const preview = await displayable(blob);
      draft.photos = [...draft.photos, { id, blob, name: name ?? `photo-${stamp()}-${id}.png`, ...preview, state: 'waiting' }];
      draft.notify();
    } catch (error) {
      onProblem(asProblem(error));
    }
  }
  checkNext(draft, box);
}

/** Adds a picture of the camera that the service has checked already. */
export async function addChecked(draft, blob, check) {
  const id = ++last;
  const preview = await displayable(blob);
  draft.photos = [...draft.photos, { id, blob, name: `photo-${stamp()}-${id}.png`, ...preview, state: 'checked', check }];
  draft.notify();
}

/** What the service says about one picture of the board. */
export function checkPicture(draft, box, blob, name) {
  const form = new FormData();
  form.append('board', boardOf(draft.plan));
  form.append('photo', blob, name);
  return api.boxes.checkPhoto(box, form);
}

/** Date and time for a name: a calibration identifies photos by name, also those that were taken before a reload. */
const stamp = () => new Date().toISOString().replace(/\D/g, '').slice(0, 14);

export function removePhoto(draft, photo) {
  URL.revokeObjectURL(photo.url);
  draft.photos = draft.photos.filter(({ id }) => id !== photo.id);
  draft.notify();
}

/** The board has changed: earlier results do not count any more. */
export function checkAgain(draft, box) {
  draft.photos = draft.photos.map(photo => ({ ...photo, state: 'waiting', check: undefined, problem: undefined }));
  draft.notify();
  checkNext(draft, box);
}

export const retry = (draft, box, photo) => (change(draft, photo.id, { state: 'waiting' }), checkNext(draft, box));

function checkNext(draft, box) {
  const running = draft.photos.filter(({ state }) => state === 'checking').length;
  for (const photo of draft.photos.filter(({ state }) => state === 'waiting').slice(0, MAX_PARALLEL - running))
    checkPhoto(draft, box, photo);
}

async function checkPhoto(draft, box, { id, blob, name }) {
  change(draft, id, { state: 'checking', problem: undefined });
  const board = boardOf(draft.plan);
  const result = await checkPicture(draft, box, blob, name).then(
    answer => ({ state: 'checked', check: answer }),
    error => ({ state: 'failed', problem: asProblem(error) }),
  );
  // The board has changed meanwhile: the photo is checked again.
  change(draft, id, board === boardOf(draft.plan) ? result : { state: 'waiting' });
  checkNext(draft, box);
}

function change(draft, id, more) {
  draft.photos = draft.photos.map(photo => (photo.id === id ? { ...photo, ...more } : photo));
  draft.notify();
}

export const boardOf = ({ columns, rows }) => `${columns}x${rows}`;

/** Photos with the board found, of the size that most of them have: a camera is calibrated at one picture size. */
export function goodPhotos(photos) {
  const found = photos.filter(({ check }) => check?.found);
  const size = usualSize(found);
  return found.filter(photo => sizeOf(photo.check) === size);
}

export function usualSize(found) {
  const counts = new Map();
  for (const { check } of found) counts.set(sizeOf(check), (counts.get(sizeOf(check)) ?? 0) + 1);
  return [...counts].sort(([, a], [, b]) => b - a)[0]?.[0] ?? null;
}

export const sizeOf = ({ width, height }) => `${width} × ${height}`;
