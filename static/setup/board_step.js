// Step 1: the board, printed at its true size and then measured: the paper counts, not the intended size.
import { html, useId, useState } from '../preact.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { Notice } from '../parts/page/notice.js';
import { BoardSheet, fits, RULER_MM } from './board_sheet.js';
import { checkAgain } from './photos.js';

const words = t.setup.board;

/** @param {Props} props */
export function BoardStep({ box, draft }) {
  const { plan } = draft;
  const set = more => draft.setPlan(more);
  /** Another board: nothing of it has been measured yet. */
  const setDimension = name => ({ target }) => {
    if (!target.value || !target.validity.valid) return;
    const changed = { ...plan, [name]: Number(target.value) };
    set({ ...changed, square: changed.printed, ruler: undefined, measured: false });
    if (draft.photos.length) checkAgain(draft, box.id);
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
        <${Field} label=${t.box.columns} type="number" min="3" max="50" required value=${plan.columns} onInput=${setDimension('columns')} />
        <${Field} label=${t.box.rows} type="number" min="3" max="50" required value=${plan.rows} onInput=${setDimension('rows')} />
        <${Field} label=${words.printed} type="number" step="any" min="1" max="100" required value=${plan.printed}
          onInput=${setDimension('printed')} />
      </div>
      <p class="small muted">${words.otherHint}</p>
    </details>`;
}

/** The ruler shows how much the printer scaled; the calibration needs the square. */
function Measured({ plan, set }) {
  const id = useId();
  const [fieldKey, setFieldKey] = useState(0); // The ruler changes the other field, which then starts again.
  const setByRuler = ({ target }) => {
    if (!target.value || !target.validity.valid) return;
    const square = Math.round((plan.printed * 1000 * Number(target.value)) / RULER_MM) / 1000;
    set({ square, ruler: Number(target.value), measured: true });
    setFieldKey(fieldKey + 1);
  };
  const setByHand = ({ target }) =>
    target.value && target.validity.valid && set({ square: Number(target.value), ruler: undefined, measured: true });
  return html`
    <div class="fields">
      <${Field} label=${words.ruler} hint=${words.rulerHint(RULER_MM)} type="number" step="any" min=${RULER_MM / 2}
        max=${RULER_MM * 2} value=${plan.ruler} optional onInput=${setByRuler} />
      <${Field} key=${fieldKey} label=${t.box.square} hint=${words.squareHint} type="number" step="any" min="0.1"
        max="1000" required value=${plan.square} onInput=${setByHand} />
    </div>
    <label class="check" for=${id}><input id=${id} type="checkbox" checked=${plan.measured}
      onInput=${event => set({ measured: event.target.checked })} />${words.isMeasured(plan.square)}</label>`;
}
