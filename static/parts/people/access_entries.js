// Who looked at the recordings of a trainee.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { usePages } from '../../data.js';
import { date, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.accessEntries;
const PAGE = 20;

/** @param {Props} props */
export function AccessEntries({ trainee, isOwn }) {
  const { items, next, problem, busy, more } = usePages((cursor, signal) => api.trainees.accessEntries(trainee, { limit: PAGE, cursor }, signal), [trainee]);
  return html`
    <section class="card wide list unprinted">
      <header><h2>${isOwn ? words.ownTitle : words.title}</h2></header>
      <p class="body small muted">${words.body}</p>
      <${ProblemNotice} problem=${problem} onRetry=${more} />
      ${!items && !problem && html`<${Loading} />`}
      ${items?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${items && items.length > 0 && html`<div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.when}</th><th scope="col">${words.who}</th><th scope="col">${words.session}</th><th scope="col">${words.parts}</th></tr></thead>
        <tbody>${items.map((entry, at) => html`<tr key=${`${entry.at} ${at}`}>
          <td class="when">${dateTime(entry.at)}</td>
          <td>${entry.who ?? t.session.edits.gone}, ${t.roles[entry.role] ?? entry.role}${entry.program && html`<p class="small muted">${words.program(entry.program)}</p>`}</td>
          <td>${sessionOf(entry)}</td>
          <td>${entry.parts.map(part => words.part[part] ?? part).join(', ')}</td></tr>`)}</tbody>
      </table></div>`}
      ${next && html`<div class="pager"><button class="button" type="button" aria-disabled=${busy} onClick=${more}>${busy ? t.loading : words.more}</button></div>`}
    </section>`;
}

/** @param {Schemas['AccessEntryResponse']} entry */
const sessionOf = ({ session, task, recorded_at: at, parts }) =>
  session ? html`<a href=${href(['sessions', session])}>${task}, ${date(at)}</a>` : parts.includes('export') ? words.all : words.erased;
