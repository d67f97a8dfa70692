// The photos of the board on a bench: each is checked by the service as soon as it is there.
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { pictureOf, shown } from './pictures.js';

const AT_ONCE = 2;
let last = 0;

/** Adds chosen files or pictures of the camera; calls back with the problem of a file that is no picture. */
export async function addPhotos(bench, box, files, onProblem) {
  for (const file of files) {
    try {
      const { blob, name } = file instanceof File ? await pictureOf(file) : { blob: file, name: null };
      const id = ++last;
      const look = await shown(blob);
      bench.photos = [...bench.photos, { id, blob, name: name ?? `photo-${stamp()}-${id}.png`, ...look, state: 'waiting' }];
      bench.tell();
    } catch (error) {
      onProblem(asProblem(error));
    }
  }
  checkNext(bench, box);
}

/** The time of day in a name: a calibration knows photos by theirs, also those that were taken before a reload. */
const stamp = () => new Date().toISOString().replace(/\D/g, '').slice(0, 14);

export function removePhoto(bench, photo) {
  URL.revokeObjectURL(photo.url);
  bench.photos = bench.photos.filter(({ id }) => id !== photo.id);
  bench.tell();
}

/** The board is another: what was found counts no more. */
export function checkAgain(bench, box) {
  bench.photos = bench.photos.map(photo => ({ ...photo, state: 'waiting', check: undefined, problem: undefined }));
  bench.tell();
  checkNext(bench, box);
}

export const retry = (bench, box, photo) => (change(bench, photo.id, { state: 'waiting' }), checkNext(bench, box));

function checkNext(bench, box) {
  const running = bench.photos.filter(({ state }) => state === 'checking').length;
  for (const photo of bench.photos.filter(({ state }) => state === 'waiting').slice(0, AT_ONCE - running))
    check(bench, box, photo);
}

async function check(bench, box, { id, blob, name }) {
  change(bench, id, { state: 'checking', problem: undefined });
  const board = boardOf(bench.plan);
  const form = new FormData();
  form.append('board', board);
  form.append('photo', blob, name);
  const told = await api.boxes.checkPhoto(box, form).then(
    check => ({ state: 'checked', check }),
    error => ({ state: 'failed', problem: asProblem(error) }),
  );
  // Of another board by now: it waits for its turn once more.
  change(bench, id, board === boardOf(bench.plan) ? told : { state: 'waiting' });
  checkNext(bench, box);
}

function change(bench, id, more) {
  bench.photos = bench.photos.map(photo => (photo.id === id ? { ...photo, ...more } : photo));
  bench.tell();
}

export const boardOf = ({ columns, rows }) => `${columns}x${rows}`;

/** Photos in which the board was found, of the size that most of them have: a camera is calibrated at one picture size. */
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
