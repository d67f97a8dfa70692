// On each page, while the person follows the guide: how far it is, the next step, and the way back.
import { html } from '../../preact.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { icons } from '../page/icons.js';
import { followGuide } from './followed.js';
import { nextStep, pathOf, useFirstSteps } from './guide_state.js';

const words = t.firstSteps;

/** `address`: of the page, without its query. @param {{ address: string }} props */
export default function GuideBar({ address }) {
  const { data: guide } = useFirstSteps([address]);
  if (!guide) return null;
  const next = nextStep(guide);
  const path = next && pathOf(next, guide);
  const isHere = path?.join('/') === address;
  return html`
    <aside class="guide-bar" aria-label=${words.title}>
      <p role="status">${next ? words.done(guide.steps.filter(one => one.is_done).length, guide.steps.length) : words.allDone}${next && isHere && html`
        · <strong>${words.now(words.steps[next].title)}</strong>`}</p>
      ${next && path && !isHere && html`<a class="button main" href=${href(path)}>${words.next(words.steps[next].title)}</a>`}
      <a class="button" href=${href(['first-steps'])}>${words.all}</a>
      <button class="button bare" type="button" aria-label=${words.leave} title=${words.leave} onClick=${() => followGuide(false)}><${icons.close} /></button>
    </aside>`;
}
