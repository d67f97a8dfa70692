// All frames, each with what would be taken for tape or bare shaft on it. Frames that nothing was painted on show the
// most.
import { html } from '../preact.js';
import { t } from '../texts.js';
import { focusSoon } from '../parts/forms/focus.js';
import { removeFrame } from './frames.js';
import { MaskLayer } from './mask_layer.js';

const remove = (draft, frame) => (removeFrame(draft, frame), focusSoon('all-frames', 'setup-step'));

/** `words`: the texts of the step for these instruments. */
export const FrameStrip = ({ draft, chosen, words, onChoose, maskOf, inkOf, isAsking, isShown }) => html`
  <section class="stack tight">
    <div class="row apart"><h3 id="all-frames" tabindex="-1">${words.all}</h3>
      <span class="small muted" role="status">${isAsking ? words.asking : isShown ? words.shownHere : words.paintFirst}</span></div>
    <ul class="frames">
      ${draft.frames.map(frame => html`
        <li key=${frame.number} data-frame=${frame.number} data-masked=${String(Boolean(maskOf(frame.number)))}>
          <button class="look" type="button" aria-pressed=${frame.number === chosen} aria-label=${words.chooseFrame(frame.number + 1)}
            onClick=${() => onChoose(frame.number)}>
            <img src=${frame.url} alt="" />
            ${maskOf(frame.number) && html`<${MaskLayer} mask=${maskOf(frame.number)} inkOf=${inkOf} />`}
          </button>
          <div class="row apart"><span class="small">${words.frame(frame.number + 1, frame.marks.length)}</span>
            <button class="button bare" type="button" aria-label=${words.removeFrame(frame.number + 1)}
              onClick=${() => remove(draft, frame)}>${t.setup.photos.remove}</button></div>
        </li>`)}
    </ul>
  </section>`;
