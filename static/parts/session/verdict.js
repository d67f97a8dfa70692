// Whether the numbers of this session are reliable: one line, and under it the reasons with what to do.
import { html } from '../../preact.js';
import { t } from '../../texts.js';
import { findingAdvice, findingText } from '../../translate.js';
import { icons } from '../page/icons.js';
import { Prose } from '../page/prose.js';

const words = t.session.verdict;
const STYLES = {
  valid: { tone: 'good', icon: icons.good },
  usable_with_care: { tone: 'warn', icon: icons.warning },
  refused: { tone: 'bad', icon: icons.warning },
};
const TONES = { refuse: 'bad', care: 'warn' };
const MAX_SHOWN = 3; // The most important ones; the others are behind a click.

/**
 * `[shown, others]`: so many reasons, with one that refuses the session if there is any. What may explain the others comes
 * first, and does not refuse by itself.
 */
export function leadingReasons(reasons, most) {
  const refusing = reasons.findIndex(one => one.severity === 'refuse');
  if (refusing < most) return [reasons.slice(0, most), reasons.slice(most)];
  const shown = [...reasons.slice(0, most - 1), reasons[refusing]];
  return [shown, reasons.filter(one => !shown.includes(one))];
}

/** Results of earlier versions have no verdict. @param {Props} props */
export function Verdict({ quality }) {
  const style = STYLES[quality?.verdict];
  if (!style) return null;
  const reasons = quality.reasons ?? [];
  const [first, more] = leadingReasons(reasons, MAX_SHOWN);
  const mixed = new Set(reasons.map(reason => reason.severity)).size > 1;
  return html`
    <section class=${`notice ${style.tone} verdict`} aria-label=${words.name}>
      <${style.icon} />
      <div>
        <strong>${words[quality.verdict]}</strong>
        <${Reasons} reasons=${first} mixed=${mixed} />
        ${more.length > 0 && html`<details><summary>${words.more(more.length)}</summary>
          <${Reasons} reasons=${more} mixed=${mixed} /></details>`}
      </div>
    </section>`;
}

/** The severity of each reason is shown only if they differ. */
const Reasons = ({ reasons, mixed }) => reasons.length > 0 && html`
  <ul>
    ${reasons.map(reason => html`
      <li key=${`${reason.name} ${reason.tool}`}>
        ${mixed && html`<span class=${`pill ${TONES[reason.severity]}`}>${words.severities[reason.severity]}</span>${' '}`}
        <${Prose} text=${`${reason.tool ? findingText(reason) : capital(findingText(reason))}.`} />
        <span class="small muted"> <${Prose} text=${`${capital(findingAdvice(reason))}.`} /></span>
      </li>`)}
  </ul>`;

const capital = text => text.charAt(0).toUpperCase() + text.slice(1);
