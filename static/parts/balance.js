// Strengths and weaknesses in words: what the newest session that counts kept and missed, and how it stands among others.
import { html } from './preact.js';
import { number, unit } from '../format.js';
import { t } from '../texts.js';
import { Empty } from './notice.js';
import { limitWords } from './standard.js';
import { withError } from './with_error.js';

const words = t.balance;
const BETTER = { strong: 75, weak: 25 }; // Per cent; its whole interval has to lie beyond the half.

/** `progress` with the features that the standard limits. */
export function Balance({ progress }) {
  const newest = Math.max(0, ...progress.sessions.filter(session => !session.set_aside).map(session => session.number));
  const said = progress.features.map(one => judge(one, newest, progress.cohort)).filter(one => one?.kind);
  const of = kind => said.filter(one => one.kind === kind);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      ${said.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody} />` : html`<div class="body stack">
        <p class="small muted">${words.session(newest)}</p>
        <div class="balance">
          <${List} title=${words.strengths} items=${of('strong')} none=${words.noStrengths} />
          <${List} title=${words.weaknesses} items=${of('weak')} none=${words.noWeaknesses} />
          ${of('open').length > 0 && html`<${List} title=${words.open} items=${of('open')} />`}
        </div></div>`}
    </section>`;
}

const List = ({ title, items, none }) => html`
  <div class="stack tight"><h3>${title}</h3>
    ${items.length ? html`<ul>${items.map(one => html`<li key=${one.name}><strong>${one.name}</strong>${one.words}</li>`)}</ul>`
      : html`<p class="muted">${none}</p>`}</div>`;

/** A target decides where there is one, else the place; what neither decides is not said. */
function judge(one, newest, cohort) {
  const point = one.points.find(at => at.session === newest);
  const told = { name: words.of(one.title, one.tool) };
  if (!point || point.value === null)
    return one.target && { ...told, kind: 'open', words: words.unmeasured(limitWords(one.target)) };
  const place = placeWords(one.place, point, cohort);
  const value = `${point.low === null ? number(point.value) : withError(point.value, point).join(' ± ')} ${unit(one.unit)}`.trim();
  if (!one.target) return { ...told, kind: place.kind, words: place.words };
  const limit = limitWords(one.target);
  if (point.judgement === 'pass') return { ...told, kind: 'strong', words: `${words.kept(value, limit)} ${place.words}` };
  if (point.judgement === 'fail') return { ...told, kind: 'weak', words: `${words.missed(value, limit)} ${place.words}` };
  return { ...told, kind: 'open', words: `${words.undecided(value, limit, t.trainee.judgements[point.judgement])} ${place.words}` };
}

function placeWords(place, point, cohort) {
  const of = place?.session === point.session ? place.better_than : null;
  if (!of || !cohort) return { words: '' };
  const kind = of.low > 50 && of.value >= BETTER.strong ? 'strong' : of.high < 50 && of.value <= BETTER.weak ? 'weak' : null;
  return { kind, words: words.better(Math.round(of.value), Math.round(of.low), Math.round(of.high), cohort.name) };
}
