// What the marks take for tape on every frame, asked anew whenever somebody has painted: the service answers with the
// tracker's own classifier, and this file only draws what it says.
import { useEffect, useState } from '../parts/preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { annotationsOf, isMarked, tapesOf } from './marks.js';
import { isWhole } from './steps.js';

/** A hand that paints goes on for a while; it is asked when it rests. */
const REST_MS = 400;

/** `{ preview, problem, isAsking }`; a preview is of the marks as they were when it was asked for, and while it is of older ones than
 *  those that are there, it is being asked anew. */
export function usePreview(box, bench) {
  const [{ preview, problem, of }, setState] = useState({ preview: null, problem: null, of: null });
  const { frames, plan } = bench;
  const tools = plan.tools.filter(isWhole);
  const isReady = frames.length > 0 && tapesOf(tools).some(tape => isMarked(frames, tape));
  const asked = JSON.stringify([isReady, tools, frames.map(({ number, marks }) => [number, marks])]);
  useEffect(() => {
    if (!isReady) return void setState({ preview: null, problem: null, of: null });
    const controller = new AbortController();
    const ask = async () => {
      try {
        setState({ preview: await api.boxes.previewPalette(box.id, formOf(box, bench), controller.signal), problem: null, of: asked });
      } catch (error) {
        if (!controller.signal.aborted) setState(before => ({ ...before, problem: asProblem(error), of: asked }));
      }
    };
    const timer = setTimeout(ask, REST_MS);
    return () => (clearTimeout(timer), controller.abort());
  }, [asked]);
  return { preview, problem, isAsking: isReady && of !== asked };
}

/** The form of learning and of previewing: the same marks, the same pictures. */
export function formOf({ view }, { plan, frames }) {
  const annotations = annotationsOf({ tools: plan.tools.filter(isWhole), view, frames });
  const form = new FormData();
  form.append('annotations', new Blob([JSON.stringify(annotations)], { type: 'application/json' }), 'annotations.json');
  for (const { number, blob } of frames) form.append(`frame_${number}`, blob, `frame_${number}`);
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
