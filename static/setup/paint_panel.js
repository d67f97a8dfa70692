// The frame that is painted on, with its controls: label, brush, size and zoom.
import { html, useId, useState } from '../preact.js';
import { addMark, clearMarks, undoMark } from './frames.js';
import { Painter } from './painter.js';
import { NOT_TAPE } from './tapes.js';

const KINDS = ['brush', 'rectangle', 'move'];
const ZOOMS = [1, 2, 4];
const SIZES = { min: 3, max: 80, initial: 10 };

/** `colours`: the labels of tapes and bare shafts; `words`: the texts of the step for these instruments. */
export function PaintPanel({ draft, frame, colours, words, inkOf, mask }) {
  const [label, setLabel] = useState(colours[0]);
  const [kind, setKind] = useState('brush');
  const [size, setSize] = useState(SIZES.initial);
  const [zoom, setZoom] = useState(1);
  const [isMasked, setMasked] = useState(false);
  const labels = [...new Set([...colours, ...NOT_TAPE])];
  const chosen = labels.includes(label) ? label : colours[0];
  const brush = { kind, size, zoom, label: chosen };
  return html`
    <section class="stack tight">
      <h3>${words.paint(frame.number + 1)}</h3>
      ${words.paintHow.map(line => html`<p key=${line} class="small muted">${line}</p>`)}
      <${Choice} name=${words.what} options=${labels} chosen=${chosen} onChoose=${setLabel}
        show=${one => html`<i class="ink" style=${{ background: inkOf(one) }}></i>${words.labels[one] ?? one}`} />
      <div class="row">
        <${Choice} name=${words.brush} options=${KINDS} chosen=${kind} onChoose=${setKind} show=${one => words.kinds[one]} />
        <${Choice} name=${words.zoom} options=${ZOOMS} chosen=${zoom} onChoose=${setZoom} show=${one => `${one}×`} />
        <${Size} label=${words.size(size)} size=${size} onSize=${setSize} />
      </div>
      <${Painter} frame=${frame} brush=${brush} mask=${isMasked && mask} inkOf=${inkOf}
        onMark=${rectangles => addMark(draft, frame.number, chosen, rectangles)} />
      <p id="painter-keys" class="small muted">${words.keys}</p>
      <div class="row">
        <button class="button" type="button" disabled=${frame.marks.length === 0}
          onClick=${() => undoMark(draft, frame.number)}>${words.undo}</button>
        <button class="button" type="button" disabled=${frame.marks.length === 0}
          onClick=${() => clearMarks(draft, frame.number)}>${words.clear}</button>
        <button class="button" type="button" aria-pressed=${isMasked} disabled=${!mask}
          onClick=${() => setMasked(!isMasked)}>${words.mask}</button>
        <span class="small muted" role="status">${words.marks(frame.marks.length)}</span>
      </div>
    </section>`;
}

const Choice = ({ name, options, chosen, onChoose, show }) => html`
  <div class="row choice" role="group" aria-label=${name}>
    ${options.map(one => html`<button key=${one} class="button" type="button" aria-pressed=${one === chosen}
      onClick=${() => onChoose(one)}>${show(one)}</button>`)}
  </div>`;

function Size({ label, size, onSize }) {
  const id = useId();
  return html`
    <label class="row size" for=${id}><span class="label">${label}</span>
      <input id=${id} type="range" min=${SIZES.min} max=${SIZES.max} value=${size}
        onInput=${event => onSize(Number(event.target.value))} /></label>`;
}
