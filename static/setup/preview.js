// What the marks take for tape or bare shaft on every frame, requested after each painting. The service answers with the
// tracker's own classifier; this module only draws the result.
import { useEffect, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { annotationsOf, coloursOf, isBare, isMarked } from './marks.js';
import { isComplete } from './steps.js';

/** A person paints several strokes in a row: the request waits for a pause, ms. */
const PAUSE_MS = 400;
/** @type {{ preview: Schemas['PalettePreview'] | null, problem: object | null, previewed: string | null }} */
const NOTHING = { preview: null, problem: null, previewed: null };

/**
 * `{ preview, problem, isAsking }`. A preview belongs to the marks at the time of its request; if there are newer
 * marks, a new one is being requested.
 */
export function usePreview(box, draft) {
  const [{ preview, problem, previewed }, setState] = useState(NOTHING);
  const { frames, plan } = draft;
  const tools = plan.tools.filter(isComplete);
  const isReady = frames.length > 0 && coloursOf(tools).some(colour => isMarked(frames, colour));
  const question = JSON.stringify([isReady, tools, frames.map(({ number, marks }) => [number, marks])]);
  useEffect(() => {
    if (!isReady) return void setState(NOTHING);
    const controller = new AbortController();
    const ask = async () => {
      try {
        setState({ preview: await api.boxes.previewPalette(box.id, paletteForm(box, draft), controller.signal), problem: null, previewed: question });
      } catch (error) {
        if (!controller.signal.aborted) setState(before => ({ ...before, problem: asProblem(error), previewed: question }));
      }
    };
    const timer = setTimeout(ask, PAUSE_MS);
    return () => (clearTimeout(timer), controller.abort());
  }, [question]);
  return { preview, problem, isAsking: isReady && previewed !== question };
}

/**
 * The form for learning and for previewing: the same marks, the same pictures.
 *
 * @param {Schemas['BoxResponse']} box
 * @param {any} draft
 */
export function paletteForm({ view }, { plan, frames }) {
  const annotations = annotationsOf({ tools: plan.tools.filter(isComplete), view, frames });
  const form = new FormData();
  form.append('annotations', new Blob([JSON.stringify(annotations)], { type: 'application/json' }), 'annotations.json');
  for (const { number, blob } of frames) form.append(`frame_${number}`, blob, `frame_${number}`);
  return form;
}

/**
 * The form for learning, with the picture of the empty box. Without one the service keeps that of the box.
 *
 * @param {Schemas['BoxResponse']} box
 * @param {any} draft
 */
export function learningForm(box, draft) {
  const form = paletteForm(box, draft);
  const { plan, emptyBox } = draft;
  if (!plan.tools.some(isBare)) return form;
  if (emptyBox) form.append('empty_box', emptyBox.blob, 'empty_box');
  else if (emptyBox === null) form.append('keep_empty_box', 'false');
  return form;
}

/** Draws a frame's mask in the inks of its classes; `ink(class)` is a CSS colour. */
export function drawMask(canvas, { cell_px, columns, rows, runs, width, height }, ink) {
  canvas.width = columns;
  canvas.height = rows;
  // A cell at the edge may reach beyond the picture: the mask is laid over the picture cell by cell.
  canvas.style.width = `${(100 * columns * cell_px) / width}%`;
  canvas.style.height = `${(100 * rows * cell_px) / height}%`;
  const brush = canvas.getContext('2d');
  let at = 0;
  for (const [kind, cells] of runs) {
    if (kind > 0) {
      brush.fillStyle = ink(kind);
      for (let i = at; i < at + cells; ) {
        const [column, row] = [i % columns, Math.floor(i / columns)];
        const length = Math.min(at + cells - i, columns - column);
        brush.fillRect(column, row, length, 1);
        i += length;
      }
    }
    at += cells;
  }
}
