// Strengths and weaknesses in words: the targets that the newest counting session met or missed, and its place in the
// cohort.
import { html } from '../../preact.js';
import { unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureTitle, handText } from '../../translate.js';
import { Empty } from '../page/notice.js';
import { limitText } from '../tasks/standard.js';
import { pointText } from '../../with_error.js';

const words = t.balance;
const PLACE_LIMITS = { strong: 75, weak: 25 }; // Per cent of the cohort; the whole interval must also lie beyond 50.

/** `progress` must contain the features that the standard limits. @param {Props} props */
export function StrengthsAndWeaknesses({ progress }) {
  const newest = Math.max(0, ...progress.sessions.filter(session => !session.set_aside).map(session => session.number));
  const judged = progress.features.map(one => judge(one, newest, progress.cohort)).filter(one => one?.kind);
  const ofKind = kind => judged.filter(one => one.kind === kind);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      ${judged.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody} />` : html`<div class="body stack">
        <p class="small muted">${words.session(newest)}</p>
        <div class="balance">
          <${List} title=${words.strengths} items=${ofKind('strong')} none=${words.noStrengths} />
          <${List} title=${words.weaknesses} items=${ofKind('weak')} none=${words.noWeaknesses} />
          ${ofKind('open').length > 0 && html`<${List} title=${words.open} items=${ofKind('open')} />`}
        </div></div>`}
    </section>`;
}

const List = ({ title, items, none }) => html`
  <div class="stack tight"><h3>${title}</h3>
    ${items.length ? html`<ul>${items.map(one => html`<li key=${one.name}><strong>${one.name}</strong>${one.words}</li>`)}</ul>`
      : html`<p class="muted">${none}</p>`}</div>`;

/** A target decides if there is one, else the place in the cohort. A feature that neither decides is left out. */
function judge(one, newest, cohort) {
  const point = one.points.find(at => at.session === newest);
  const base = { name: words.of(featureTitle(one), handText(one)) };
  if (!point || point.value === null)
    return one.target && { ...base, kind: 'open', words: words.unmeasured(limitText(one.target)) };
  const place = placeWords(one.place, point, cohort);
  const value = `${pointText(point)} ${unit(one.unit)}`.trim();
  if (!one.target) return { ...base, kind: place.kind, words: place.words };
  const limit = limitText(one.target);
  if (point.judgement === 'pass') return { ...base, kind: 'strong', words: `${words.kept(value, limit)} ${place.words}` };
  if (point.judgement === 'fail') return { ...base, kind: 'weak', words: `${words.missed(value, limit)} ${place.words}` };
  return { ...base, kind: 'open', words: `${words.undecided(value, limit, t.trainee.judgements[point.judgement])} ${place.words}` };
}

function placeWords(place, point, cohort) {
  const betterThan = place?.session === point.session ? place.better_than : null;
  if (!betterThan || !cohort) return { words: '' };
  const kind = betterThan.low > 50 && betterThan.value >= PLACE_LIMITS.strong ? 'strong' : betterThan.high < 50 && betterThan.value <= PLACE_LIMITS.weak ? 'weak' : null;
  return { kind, words: words.better(Math.round(betterThan.value), Math.round(betterThan.low), Math.round(betterThan.high), cohort.name) };
}
