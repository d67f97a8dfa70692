// What to work on next: at most three things, each with its number, its limit and the stretches that show it.
import { html } from '../../preact.js';
import { number, unit } from '../../format.js';
import { t } from '../../texts.js';
import { adviceText, featureTitle, noAdviceText } from '../../translate.js';
import { amountText, StretchButton } from './evidence.js';

const words = t.session.advice;

/** @param {Props} props */
export function Advice({ advice, playback }) {
  if (!advice) return null;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        ${advice.none && html`<p class="muted">${noAdviceText(advice.none)}</p>`}
        ${advice.items.length > 0 && html`<ol class="advice">
          ${advice.items.map(item => html`<li key=${`${item.feature} ${item.tool} ${item.space}`}><${Item} item=${item}
            playback=${playback} /></li>`)}
        </ol>`}
      </div>
    </section>`;
}

/** @param {Props} props */
function Item({ item, playback }) {
  const unitSuffix = unit(item.unit) ? ` ${unit(item.unit)}` : '';
  return html`
    <p><strong>${adviceText(item)}</strong></p>
    <p class="small">${words.measured(featureTitle(item), item.tool, `${number(item.value)}${unitSuffix}`, number(item.error.low),
      number(item.error.high))} ${words.limit[item.better](`${number(item.limit)}${unitSuffix}`)}</p>
    <div class="row">
      <span class="small muted">${words.look}</span>
      ${item.stretches.map(stretch => html`<${StretchButton} key=${stretch.from_s} stretch=${stretch} playback=${playback}>
        <small>${amountText(stretch, { unit: item.amount_unit })}</small><//>`)}
    </div>`;
}
