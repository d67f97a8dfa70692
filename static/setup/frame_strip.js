// All frames, each with what would be taken for tape or bare shaft on it. Frames that nothing was painted on show the
// most.
import { html } from '../preact.js';
import { t } from '../texts.js';
import { focusSoon } from '../parts/forms/focus.js';
import { removeFrame } from './frames.js';
import { MaskLayer } from './mask_layer.js';
import { ShaftLayer } from './shaft_layer.js';

const remove = (draft, frame) => (removeFrame(draft, frame), focusSoon('all-frames', 'setup-step'));

/** What was found of an instrument's shaft: all of it, its edges alone, or nothing. */
const foundOf = ({ edges_px, end_px }) => (end_px ? 'whole' : edges_px ? 'edges' : 'nothing');

/**
 * `words`: the texts of the step for these instruments. `shaftsOf(number)`: the shafts of instruments without tape on a
 * frame.
 */
export const FrameStrip = ({ draft, chosen, words, onChoose, maskOf, shaftsOf, inkOf, isAsking, isShown }) => html`
  <section class="stack tight">
    <div class="row apart"><h3 id="all-frames" tabindex="-1">${words.all}</h3>
      <span class="small muted" role="status">${isAsking ? words.asking : isShown ? words.shownHere : words.paintFirst}</span></div>
    <ul class="frames">
      ${draft.frames.map(frame => html`
        <li key=${frame.number} data-frame=${frame.number} data-masked=${String(Boolean(maskOf(frame.number)))}>
          <button class="look" type="button" aria-pressed=${frame.number === chosen} aria-label=${words.chooseFrame(frame.number + 1)}
            onClick=${() => onChoose(frame.number)}>
            <img src=${frame.url} alt="" />
            ${maskOf(frame.number) && html`<${MaskLayer} mask=${maskOf(frame.number)} inkOf=${inkOf} />
              <${ShaftLayer} mask=${maskOf(frame.number)} shafts=${shaftsOf(frame.number)} />`}
          </button>
          ${shaftsOf(frame.number).map(shaft => html`
            <div key=${shaft.tool} class="small" data-shaft=${foundOf(shaft)}>${words.shaft[foundOf(shaft)](shaft.tool)}</div>`)}
          <div class="row apart"><span class="small">${words.frame(frame.number + 1, frame.marks.length)}</span>
            <button class="button bare" type="button" aria-label=${words.removeFrame(frame.number + 1)}
              onClick=${() => remove(draft, frame)}>${t.setup.photos.remove}</button></div>
        </li>`)}
    </ul>
  </section>`;
