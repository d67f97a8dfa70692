// A sheet of paper: a printed page on a session or a trainee, black on white, on one side of A4.
import { html } from '../../preact.js';
import { dateTime, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { notEnoughText } from '../../translate.js';
import { withError } from '../../with_error.js';
import { CentreLetterhead } from './centre_mark.js';

const words = t.report;

/** The sheet, and above it the parts that are not printed: a link back and the print button. */
export const Sheet = ({ title, back, kind = '', hint = words.hint, footer = words.printed, children }) => {
  document.title = `${title} – ${t.product}`; // Also the name that a browser saves the sheet under.
  return html`
  <div class="report-bar row">
    <a class="button" href=${href(back)}>${words.back}</a>
    <button class="button main" type="button" onClick=${() => print()}>${words.print}</button>
    <span class="small muted">${hint}</span>
  </div>
  <article class=${`report ${kind}`}>
    <header><${CentreLetterhead} /><h1 tabindex="-1">${title}</h1></header>
    ${children}
    <footer>${footer(dateTime(new Date().toISOString()))}</footer>
  </article>`;
};

/** Pairs of a name and a value; those without a value are left out. */
export const Facts = ({ rows }) => html`
  <dl class="about">${rows.filter(([, value]) => value).map(([name, value]) => html`
    <div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;

/**
 * A short reference to a thing with an id: its last digits, which are enough to recognise its page.
 *
 * @param {string | null | undefined} id
 */
export const reference = id => id && id.slice(-8);

/** The versions and ids that the numbers can be traced to: short for reading, complete where exactness matters. */
export const Provenance = ({ rows }) => html`
  <section class="provenance">
    <h2>${words.provenance}</h2>
    <dl>${rows.filter(([, value]) => value !== null && value !== undefined && value !== '').map(([name, value]) => html`
      <div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>
  </section>`;

/**
 * `61.2 ± 0.8 s`. Says if the error is not known; without a value, gives the reason.
 *
 * @param {{ value?: number | null, error?: { low: number, high: number } | null, not_enough?: string | null,
 *   not_enough_reason?: { code: string, numbers: number[] } | null, is_lower_bound?: boolean, unit: string }} feature
 */
export function measuredText(feature) {
  const { value, error, is_lower_bound: isLowerBound, unit: name } = feature;
  if (value === null || value === undefined) return notEnoughText(feature).text || words.notMeasured;
  if (isLowerBound) return `${t.session.atLeast(number(value))} ${unit(name)}`.trim();
  const text = error ? withError(value, error).join(' ± ') : `${number(value)} ${words.errorUnknown}`;
  return `${text} ${unit(name)}`.trim();
}

/** `at most 50 s`. */
export const limitWithUnit = (target, name) =>
  words.limits[target.better](`${number(target.limit)} ${unit(name)}`.trim());
