// Step 1: the board, printed at its true size, and measured: what counts is the paper, not what was meant.
import { html, useId, useState } from '../parts/preact.js';
import { t } from '../texts.js';
import { Field } from '../parts/form.js';
import { Notice } from '../parts/notice.js';
import { BoardSheet, fits, RULER_MM } from './board_sheet.js';
import { checkAgain } from './photos.js';

const words = t.setup.board;

export function BoardStep({ box, bench }) {
  const { plan } = bench;
  const set = more => bench.setPlan(more);
  /** Another board: nothing of it has been measured yet. */
  const count = name => ({ target }) => {
    if (!target.value || !target.validity.valid) return;
    const changed = { ...plan, [name]: Number(target.value) };
    set({ ...changed, square: changed.printed, ruler: undefined, measured: false });
    if (bench.photos.length) checkAgain(bench, box.id);
  };
  const isPrintable = fits(plan);
  return html`
    <ol class="numbered">
      <li>${words.print}</li>
      <li>${words.flat}</li>
      <li>${words.measure(RULER_MM)}</li>
    </ol>
    <div class="board-sheet">${isPrintable ? html`<${BoardSheet} plan=${plan} />` : html`<${Notice} tone="warn"
      title=${words.tooLarge}>${words.tooLargeBody}<//>`}</div>
    <div class="row">
      <button class="button main" type="button" disabled=${!isPrintable} onClick=${() => print()}>${words.button}</button>
    </div>
    <${Measured} plan=${plan} set=${set} />
    <details>
      <summary>${words.other}</summary>
      <div class="fields">
        <${Field} label=${t.box.columns} type="number" min="3" max="50" required value=${plan.columns} onInput=${count('columns')} />
        <${Field} label=${t.box.rows} type="number" min="3" max="50" required value=${plan.rows} onInput=${count('rows')} />
        <${Field} label=${words.printed} type="number" step="any" min="1" max="100" required value=${plan.printed}
          onInput=${count('printed')} />
      </div>
      <p class="small muted">${words.otherHint}</p>
    </details>`;
}

/** The ruler tells by how much the printer scaled; the square is what the calibration needs. */
function Measured({ plan, set }) {
  const id = useId();
  const [turn, setTurn] = useState(0); // The ruler writes into the other field.
  const byRuler = ({ target }) => {
    if (!target.value || !target.validity.valid) return;
    const square = Math.round((plan.printed * 1000 * Number(target.value)) / RULER_MM) / 1000;
    set({ square, ruler: Number(target.value), measured: true });
    setTurn(turn + 1);
  };
  const byHand = ({ target }) =>
    target.value && target.validity.valid && set({ square: Number(target.value), ruler: undefined, measured: true });
  return html`
    <div class="fields">
      <${Field} label=${words.ruler} hint=${words.rulerHint(RULER_MM)} type="number" step="any" min=${RULER_MM / 2}
        max=${RULER_MM * 2} value=${plan.ruler} optional onInput=${byRuler} />
      <${Field} key=${turn} label=${t.box.square} hint=${words.squareHint} type="number" step="any" min="0.1"
        max="1000" required value=${plan.square} onInput=${byHand} />
    </div>
    <label class="check" for=${id}><input id=${id} type="checkbox" checked=${plan.measured}
      onInput=${event => set({ measured: event.target.checked })} />${words.isMeasured(plan.square)}</label>`;
}
