// The first steps of a new centre, also after they were hidden on Today.
import { html } from '../preact.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { FirstSteps } from '../parts/guide/first_steps.js';
import { useHidden } from '../parts/guide/followed.js';
import { useFirstSteps } from '../parts/guide/guide_state.js';
import { Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.firstSteps;

/** @param {Props} props */
export default function FirstStepsPage({ person }) {
  const { data: guide, problem, reload } = useFirstSteps([]);
  const [isHidden, hide] = useHidden(person);
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      ${guide?.is_empty && isHidden && html`<button class="button" type="button" onClick=${() => hide(false)}>${words.show}</button>`}
      <a class="button" href=${href([])}>${t.nav.today}</a>
    <//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!guide && !problem && html`<${Loading} />`}
    ${guide && html`<${FirstSteps} guide=${guide} />`}`;
}
