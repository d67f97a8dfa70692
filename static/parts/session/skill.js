// The skill model's verdict on this session, its accuracy, and the features that carried the verdict; or why there is
// none.
import { html } from '../../preact.js';
import { number, percent, unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureTitle } from '../../translate.js';

const words = t.session.skill;
const LEVELS = ['novice', 'intermediate', 'expert'];
const wholePercent = share => percent(Math.round(100 * share) / 100);

/** For a refused session the page already says everything, and without a model there is nothing to say. @param {Props} props */
export function Skill({ verdict }) {
  if (!verdict || ['refused', 'no_model'].includes(verdict.reason?.name ?? '')) return null;
  const { level, reason, probabilities, carried, accuracy, accuracy_where_given: given, model } = verdict;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2>${model && html`<span class="small muted">${words.version(model)}</span>`}</header>
      <div class="body stack tight">
        <p><strong>${level ? words.levels[level] : words.none}</strong>${level && probabilities
          ? ` ${words.probability(wholePercent(probabilities[level]))}` : `: ${words.reasons[reason?.name ?? ''] ?? reason?.detail}`}</p>
        ${!level && probabilities && html`<p class="small muted">${words.all(LEVELS.map(name =>
          `${words.levels[name]} ${wholePercent(probabilities[name])}`))}</p>`}
        ${carried.length > 0 && html`<${Carried} carried=${carried} likeliest=${likeliest(probabilities)} />`}
        ${probabilities && reason?.name !== 'knows_nothing' && accuracy && html`<p class="small muted">${accuracyText(given ?? accuracy, Boolean(given))}</p>`}
      </div>
    </section>`;
}

const likeliest = probabilities =>
  probabilities && LEVELS.reduce((best, name) => (probabilities[name] > probabilities[best] ? name : best));

const accuracyText = (share, isGiven) =>
  words[isGiven ? 'worthGiven' : 'worth'](wholePercent(share.value), wholePercent(share.low), wholePercent(share.high), share.people);

const Carried = ({ carried, likeliest: level }) => html`
  <div class="scroll">
    <table class="table">
      <caption class="small muted">${words.carriedBy}</caption>
      <thead><tr><th scope="col">${words.feature}</th><th scope="col" class="number">${words.here}</th>
        <th scope="col" class="number">${words.usual}</th><th scope="col">${words.speaks(words.levels[level])}</th></tr></thead>
      <tbody>
        ${carried.map(feature => html`
          <tr key=${feature.feature}>
            <th scope="row">${featureTitle(feature)}</th>
            <td class="number">${number(feature.value)} ${unit(feature.unit)}</td>
            <td class="number">${number(feature.mean)} ${unit(feature.unit)}</td>
            <td>${words.raises(wholePercent(Math.abs(feature.raises)), feature.raises < 0)}</td>
          </tr>`)}
      </tbody>
    </table>
  </div>`;
