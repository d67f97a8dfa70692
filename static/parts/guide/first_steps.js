// The first steps of a new centre: each with one button to the page that does it, and a tick when it is done.
import { html } from '../../preact.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { icons } from '../page/icons.js';
import { followGuide } from './followed.js';
import { nextStep, pathOf } from './guide_state.js';

const words = t.firstSteps;

/** `onHide`: hides the guide; without it there is no such button. @param {{ guide: Schemas['FirstSteps'], onHide?: () => void }} props */
export function FirstSteps({ guide, onHide }) {
  const next = nextStep(guide);
  const done = guide.steps.filter(one => one.is_done).length;
  return html`
    <section class="card guide">
      <header><div><h2>${words.title}</h2><p class="small muted">${next ? words.done(done, guide.steps.length) : words.allDone}</p></div>
        ${onHide && html`<button class="button bare" type="button" onClick=${onHide}>${words.hide}</button>`}</header>
      <ol class="guide-steps">
        ${guide.steps.map(({ step, is_done: isDone }, at) => html`
          <li key=${step} class=${isDone ? 'done' : step === next ? 'next' : ''}>
            <span class="guide-mark" aria-hidden="true">${isDone ? html`<${icons.good} />` : at + 1}</span>
            <div><strong>${words.steps[step].title}</strong>${isDone && html`<span class="unseen"> (${words.isDone})</span>`}
              <p class="small muted">${words.steps[step].body}</p></div>
            <a class=${`button ${step === next ? 'main' : ''}`} href=${href(pathOf(step, guide))} aria-label=${`${words.steps[step].title}: ${isDone ? words.look : words.go}`}
              onClick=${() => followGuide(true)}>${isDone ? words.look : words.go}</a>
          </li>`)}
      </ol>
    </section>`;
}
