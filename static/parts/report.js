// A sheet of paper: what a printed page says of a session or a trainee, black on white, on one side of A4.
import { html } from './preact.js';
import { dateTime, number, unit } from '../format.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { withError } from './with_error.js';

const words = t.report;

/** The sheet, and above it what is not printed: the way back and the button. */
export const Sheet = ({ title, back, kind = '', footer = words.printed, children }) => {
  document.title = `${title} – ${t.product}`; // Also the name under which a browser saves the sheet.
  return html`
  <div class="report-bar row">
    <a class="button" href=${href(back)}>${words.back}</a>
    <button class="button main" type="button" onClick=${() => print()}>${words.print}</button>
    <span class="small muted">${words.hint}</span>
  </div>
  <article class=${`report ${kind}`}>
    <header><p>${words.brand}</p><h1 tabindex="-1">${title}</h1></header>
    ${children}
    <footer>${footer(dateTime(new Date().toISOString()))}</footer>
  </article>`;
};

/** Pairs of a name and what it is; those without a value are left out. */
export const Facts = ({ of }) => html`
  <dl class="about">${of.filter(([, value]) => value).map(([name, value]) => html`
    <div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;

/** What made the numbers, to be found again: short for reading, whole where it must be exact. */
export const Provenance = ({ of }) => html`
  <section class="provenance">
    <h2>${words.provenance}</h2>
    <dl>${of.filter(([, value]) => value !== null && value !== undefined && value !== '').map(([name, value]) => html`
      <div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>
  </section>`;

/** `61.2 ± 0.8 s`; where the error is not known, that is said, and where there is no value, why. */
export function measured({ value, error, not_enough: why, unit: name }) {
  if (value === null || value === undefined) return why ?? words.notMeasured;
  const said = error ? withError(value, error).join(' ± ') : `${number(value)} ${words.errorUnknown}`;
  return `${said} ${unit(name)}`.trim();
}

/** `at most 50 s`. */
export const limitOf = (target, name) =>
  words.limits[target.better](`${number(target.limit)} ${unit(name)}`.trim());
