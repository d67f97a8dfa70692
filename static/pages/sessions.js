// All sessions, with filters that are part of the address, so that a filtered list can be sent to a colleague.
import { html, useEffect, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData, useThrottled } from '../data.js';
import { clock, dateTime } from '../format.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { Announce, Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { ArrivalNote } from '../parts/page/recorded_at.js';
import { Outcome } from '../parts/page/status.js';

const words = t.sessions;
const FILTERS = ['trainee', 'task', 'box', 'status'];
const STATES = ['receiving', 'queued', 'tracking', 'done', 'failed'];
const PAGE = 50;
/** @type {{ items: Schemas['SessionResponse'][], next?: string | null, problem: object | null }} */
const NO_MORE = { items: [], next: undefined, problem: null };

/** @param {Props} props */
export default function Sessions({ person, route }) {
  const filter = Object.fromEntries(FILTERS.map(name => [name, route.query.get(name) ?? undefined]));
  const filtered = FILTERS.some(name => filter[name]);
  const { data, problem, reload } = useData(
    signal => api.sessions.page({ ...filter, limit: PAGE }, signal),
    [route.query.toString()],
  );
  const [more, setMore] = useState(NO_MORE);
  const reloadSoon = useThrottled(reload, 1500);
  useLive('session', reloadSoon);
  useLive('resync', reload);
  useEffect(() => setMore(NO_MORE), [route.query.toString()]);

  const next = more.next === undefined ? data?.next : more.next;
  const showMore = async () => {
    try {
      const page = await api.sessions.page({ ...filter, limit: PAGE, cursor: next });
      setMore(before => ({ items: [...before.items, ...page.items], next: page.next, problem: null }));
    } catch (error) {
      setMore(before => ({ ...before, problem: asProblem(error) }));
    }
  };
  const items = unique([...(data?.items ?? []), ...more.items]);
  return html`
    <${PageHead} title=${words.title} lead=${words.lead} />
    <${ProblemNotice} problem=${problem ?? more.problem} onRetry=${reload} />
    <section class="card">
      <${Filters} person=${person} filter=${filter} />
      <${Announce}>${data && words.count(items.length)}<//>
      ${!data && !problem && html`<${Loading} />`}
      ${data && items.length === 0 && html`<${Empty} title=${words.none} body=${filtered ? words.noneFiltered : words.noneBody}>
        ${filtered ? html`<button class="button" type="button" onClick=${() => replace(['sessions'])}>
          ${words.clear}</button>` : html`<a class="button main" href=${href(['upload'])}>${t.today.upload}</a>`}
      <//>`}
      ${items.length > 0 && html`<${Table} items=${items} />`}
      ${next && html`<div class="more"><button class="button" type="button" onClick=${showMore}>
        ${words.more}</button></div>`}
    </section>`;
}

/** A session that moves from one page to the next while the list is loaded must not appear twice. */
const unique = items => [...new Map(items.map(item => [item.id, item])).values()];

/** @param {Props} props */
function Filters({ person, filter }) {
  const lists = useData(async () => {
    const trainees = may(person, 'see_trainees') ? api.trainees.all() : [];
    const boxes = may(person, 'see_boxes') ? api.boxes.all() : [];
    const [trainee, task, box] = await Promise.all([trainees, api.tasks.all(), boxes]);
    return { trainee, task, box };
  }, []).data;
  const set = name => event => replace(['sessions'], { ...filter, [name]: event.target.value });
  const choices = name => [['', words.any], ...(lists?.[name] ?? []).map(item => [item.id, item.name])];
  return html`
    <div class="filters" role="search" aria-label=${words.title}>
      ${may(person, 'see_trainees') && html`<${Field} type="select" label=${words.trainee} value=${filter.trainee}
        options=${choices('trainee')} onInput=${set('trainee')} />`}
      <${Field} type="select" label=${words.task} value=${filter.task} options=${choices('task')}
        onInput=${set('task')} />
      ${may(person, 'see_boxes') && html`<${Field} type="select" label=${words.box} value=${filter.box}
        options=${choices('box')} onInput=${set('box')} />`}
      <${Field} type="select" label=${words.status} value=${filter.status}
        options=${[['', words.any], ...STATES.map(state => [state, t.status[state]])]} onInput=${set('status')} />
    </div>`;
}

const Table = ({ items }) => html`
  <div class="scroll">
    <table class="table">
      <thead>
        <tr>
          <th scope="col">${words.recorded}</th>
          <th scope="col">${words.trainee}</th>
          <th scope="col">${words.task}</th>
          <th scope="col" class="second">${words.box}</th>
          <th scope="col" class="third">${words.file}</th>
          <th scope="col" class="number second">${words.length}</th>
          <th scope="col">${words.status}</th>
        </tr>
      </thead>
      <tbody>
        ${items.map(session => html`
            <tr key=${session.id}>
              <th scope="row" class="when"><a class="cover" href=${href(['sessions', session.id])}>
                ${dateTime(session.recorded_at)}</a><${ArrivalNote} session=${session} /></th>
              <td>${session.trainee?.name}</td>
              <td>${session.task?.name}</td>
              <td class="second">${session.box?.name}</td>
              <td class="muted third">${session.filename}</td>
              <td class="number second">${session.video ? clock(session.video.duration_s, 0) : '–'}</td>
              <td><${Outcome} session=${session} /></td>
            </tr>`)}
      </tbody>
    </table>
  </div>`;
