// A recording that waits for a name: its picture, what is known of it, and what a person chooses for it.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { bytes, date, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { problemTitle } from '../../translate.js';
import { ProblemDetail } from '../page/prose.js';

const words = t.waiting;
export const KINDS = ['trainee', 'task', 'box'];

/** What is chosen for a recording at first: what it came with, else what its names speak of. */
export const firstChoice = item =>
  Object.fromEntries(KINDS.map(kind => [kind, item[kind]?.id ?? item.proposal[kind]?.id ?? '']));

const isProposed = (item, kind, choice) => !item[kind] && item.proposal[kind] && item.proposal[kind].id === choice[kind];

/** @param {Props} props */
export function WaitingRow({ item, lists, choice, isChosen, problem, onChoose, onSet, onPlay }) {
  const name = [item.folder, item.filename].filter(Boolean).join('/');
  return html`
    <tr>
      <td><label class="check pick"><input type="checkbox" checked=${isChosen} aria-label=${words.pick(name)}
        onInput=${event => onChoose(event.target.checked)} /></label></td>
      <td><${Picture} item=${item} name=${name} onPlay=${onPlay} /></td>
      <th scope="row" class="waiting-name">
        <span>${name}</span>
        <span class="small muted">${item.recorded_at ? words.recordedAt(dateTime(item.recorded_at))
          : words.arrivedAt(dateTime(item.arrived_at))} · ${bytes(item.bytes)} · ${words.sources[item.source]}${
            item.sender ? ` · ${item.sender}` : ''}</span>
        <span class="small muted">${words.deletedOn(date(item.deleted_at))}</span>
        ${item.unreadable && html`<span class="small warn-text">${words.unreadable} ${item.unreadable}</span>`}
        ${item.remark && html`<span class="small warn-text">${item.remark}</span>`}
        ${problem && html`<span class="small warn-text" role="alert"><${RowProblem} problem=${problem} /></span>`}
      </th>
      ${KINDS.map(kind => html`
        <td key=${kind}>
          <div class="field"><select aria-label=${words.choiceFor(t.target[kind], name)} value=${choice[kind]} onInput=${event => onSet(kind, event.target.value)}>
            <option value="" selected=${!choice[kind]}>${t.target.choose}</option>
            ${lists[kind].map(one => html`<option key=${one.id} value=${one.id} selected=${one.id === choice[kind]}>${one.name}</option>`)}
          </select></div>
          ${isProposed(item, kind, choice) && html`<span class="small muted">${words.proposed}</span>`}
        </td>`)}
    </tr>`;
}

/** Why a recording waits on. */
function RowProblem({ problem }) {
  const shown = new Problem(problem);
  const session = problem.session?.split('/').pop();
  return html`${problemTitle(shown)}. <${ProblemDetail} problem=${shown} />${session && html` <a
    href=${href(['sessions', session])}>${words.openSession}</a>`}`;
}

/** A picture of the recording, which plays it. @param {Props} props */
function Picture({ item, name, onPlay }) {
  const [isMissing, setMissing] = useState(false);
  const isShown = !item.unreadable && !isMissing;
  return html`<button class="button bare picture" type="button" aria-label=${words.play(name)} title=${words.play(name)} onClick=${onPlay}>
    ${isShown ? html`<img src=${api.waiting.pictureAddress(item.id)} alt="" loading="lazy" width="120" height="90" onError=${() => setMissing(true)} />`
      : html`<span class="no-picture">${words.noPicture}</span>`}</button>`;
}
