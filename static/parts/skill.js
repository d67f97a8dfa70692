// What the task's model of skill says of this session, how good such models are, and what carried the verdict; or why there is none.
import { html } from './preact.js';
import { number, percent, unit } from '../format.js';
import { t } from '../texts.js';

const words = t.session.skill;
const LEVELS = ['novice', 'intermediate', 'expert'];
const whole = share => percent(Math.round(100 * share) / 100);

/** Of a refused session there is nothing to say that the page does not say already. */
export function Skill({ verdict }) {
  if (!verdict || verdict.reason?.name === 'refused') return null;
  const { level, reason, probabilities, carried, accuracy, accuracy_where_given: given, model } = verdict;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2>${model && html`<span class="small muted">${words.version(model)}</span>`}</header>
      <div class="body stack tight">
        <p><strong>${level ? words.levels[level] : words.none}</strong>${level
          ? ` ${words.probability(whole(probabilities[level]))}` : `: ${words.reasons[reason?.name] ?? reason?.detail}`}</p>
        ${!level && probabilities && html`<p class="small muted">${words.all(LEVELS.map(of =>
          `${words.levels[of]} ${whole(probabilities[of])}`))}</p>`}
        ${carried.length > 0 && html`<${Carried} carried=${carried} likeliest=${likeliest(probabilities)} />`}
        ${probabilities && reason?.name !== 'knows_nothing' && accuracy && html`<p class="small muted">${worth(given ?? accuracy, Boolean(given))}</p>`}
      </div>
    </section>`;
}

const likeliest = probabilities =>
  probabilities && LEVELS.reduce((best, of) => (probabilities[of] > probabilities[best] ? of : best));

const worth = (share, isGiven) =>
  words[isGiven ? 'worthGiven' : 'worth'](whole(share.value), whole(share.low), whole(share.high), share.people);

const Carried = ({ carried, likeliest: level }) => html`
  <div class="scroll">
    <table class="table">
      <caption class="small muted">${words.carriedBy}</caption>
      <thead><tr><th scope="col">${words.feature}</th><th scope="col" class="number">${words.here}</th>
        <th scope="col" class="number">${words.usual}</th><th scope="col">${words.speaks(words.levels[level])}</th></tr></thead>
      <tbody>
        ${carried.map(of => html`
          <tr key=${of.feature}>
            <th scope="row">${of.title}</th>
            <td class="number">${number(of.value)} ${unit(of.unit)}</td>
            <td class="number">${number(of.mean)} ${unit(of.unit)}</td>
            <td>${words.raises(whole(Math.abs(of.raises)), of.raises < 0)}</td>
          </tr>`)}
      </tbody>
    </table>
  </div>`;
