// All sessions, with filters that are part of the address, so that a filtered list can be sent to a colleague.
import { html, useEffect, useRef, useState } from '../preact.js';
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
const FILTERS = ['search', 'trainee', 'task', 'box', 'outcome', 'status', 'from', 'to'];
/** The most wanted first. */
const OUTCOMES = ['passed', 'missed', 'undecided', 'done', 'usable_with_care', 'refused', 'failed', 'quarantined', 'box_asked', 'other_box', 'queued', 'tracking', 'receiving'];
/** @type {('recorded' | 'arrival')[]} */
const ORDERS = ['recorded', 'arrival'];
const PAGE = 50;
const TYPING_MS = 300;
/** @type {{ items: Schemas['SessionResponse'][], next?: string | null, problem: object | null }} */
const NO_MORE = { items: [], next: undefined, problem: null };

/** The first moment of a day of the reader's calendar, `days` later. */
function startOfDay(day, days = 0) {
  const at = new Date(`${day}T00:00`);
  at.setDate(at.getDate() + days);
  return Number.isNaN(at.getTime()) ? undefined : at.toISOString();
}

/** What the service is asked, from the filters in the address. @param {Record<string, any>} filter */
const asked = ({ from, to, ...rest }) => ({
  ...rest,
  recorded_from: from && startOfDay(from),
  recorded_before: to && startOfDay(to, 1),
});

/** @param {Props} props */
export default function Sessions({ person, route }) {
  const filter = Object.fromEntries(FILTERS.map(name => [name, route.query.get(name) || undefined]));
  const order = ORDERS.find(name => name === route.query.get('order')) ?? ORDERS[0];
  const filtered = FILTERS.some(name => filter[name]);
  const [cleared, setCleared] = useState(0);
  const { data, current, problem, reload } = useData(async signal => {
    const [page, count] = await Promise.all([
      api.sessions.page({ ...asked(filter), order, limit: PAGE }, signal),
      api.sessions.count(asked(filter), signal),
    ]);
    return { ...page, count };
  }, [route.query.toString()]);
  const [more, setMore] = useState(NO_MORE);
  // To count by outcome, the service judges every session.
  const reloadSoon = useThrottled(reload, filter.outcome ? 10_000 : 1500);
  useLive('session', reloadSoon);
  useLive('resync', reload);
  useEffect(() => setMore(NO_MORE), [route.query.toString()]);

  const next = more.next === undefined ? data?.next : more.next;
  const showMore = async () => {
    try {
      const page = await api.sessions.page({ ...asked(filter), order, limit: PAGE, cursor: next });
      setMore(before => ({ items: [...before.items, ...page.items], next: page.next, problem: null }));
    } catch (error) {
      setMore(before => ({ ...before, problem: asProblem(error) }));
    }
  };
  const clear = () => {
    setCleared(times => times + 1);
    replace(['sessions'], { order: route.query.get('order') });
  };
  const items = unique([...(data?.items ?? []), ...more.items]);
  const count = current && words.count(items.length, current.count.matching, current.count.all - current.count.matching);
  return html`
    <${PageHead} title=${words.title} lead=${words.leads[order]} />
    <${ProblemNotice} problem=${problem ?? more.problem} onRetry=${reload} />
    <section class="card">
      <${Filters} key=${cleared} person=${person} filter=${filter} order=${order} />
      <${Announce}>${count}<//>
      ${data && html`<div class="listed small muted"><span>${count}</span>${filtered && items.length > 0 && html`
        <button class="button" type="button" onClick=${clear}>${words.clear}</button>`}</div>`}
      ${!data && !problem && html`<${Loading} />`}
      ${data && items.length === 0 && html`<${Empty} title=${words.none} body=${filtered ? words.noneFiltered : words.noneBody}>
        ${filtered ? html`<button class="button" type="button" onClick=${clear}>
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
function Filters({ person, filter, order }) {
  const lists = useData(async () => {
    const trainees = may(person, 'see_trainees') ? api.trainees.all() : [];
    const boxes = may(person, 'see_boxes') ? api.boxes.all() : [];
    const [trainee, task, box] = await Promise.all([trainees, api.tasks.all(), boxes]);
    return { trainee, task, box };
  }, []).data;
  const typing = useRef(null);
  useEffect(() => () => clearTimeout(typing.current), []);
  const latest = useRef({});
  latest.current = { ...filter, order: order === ORDERS[0] ? undefined : order };
  const put = (name, value) => replace(['sessions'], { ...latest.current, [name]: value });
  const set = name => event => put(name, event.target.value);
  const search = event => {
    const { value } = event.target;
    clearTimeout(typing.current);
    typing.current = setTimeout(() => put('search', value.trim()), TYPING_MS);
  };
  const choices = name => [['', words.any], ...(lists?.[name] ?? []).map(item => [item.id, item.name])];
  return html`
    <div class="filters" role="search" aria-label=${words.title}>
      <${Field} type="search" label=${words.search} value=${filter.search} maxlength="120" placeholder=${words.searchHint}
        onInput=${search} />
      <${Field} type="select" label=${t.outcome.name} value=${filter.outcome}
        options=${[['', words.any], ...OUTCOMES.map(name => [name, name === 'usable_with_care' ? words.withCare : t.status[name]])]}
        onInput=${set('outcome')} />
      ${may(person, 'see_trainees') && html`<${Field} type="select" label=${words.trainee} value=${filter.trainee}
        options=${choices('trainee')} onInput=${set('trainee')} />`}
      <${Field} type="select" label=${words.task} value=${filter.task} options=${choices('task')}
        onInput=${set('task')} />
      ${may(person, 'see_boxes') && html`<${Field} type="select" label=${words.box} value=${filter.box}
        options=${choices('box')} onInput=${set('box')} />`}
      <${Field} type="date" label=${words.from} value=${filter.from} max=${filter.to} onInput=${set('from')} />
      <${Field} type="date" label=${words.to} value=${filter.to} min=${filter.from} onInput=${set('to')} />
      <${Field} type="select" label=${words.order} value=${order} options=${ORDERS.map(name => [name, words.orders[name]])}
        onInput=${event => replace(['sessions'], { ...filter, order: event.target.value === ORDERS[0] ? undefined : event.target.value })} />
    </div>`;
}

const isSupervised = session => ['sent_by_staff', 'marked'].includes(session.supervision);

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
          <th scope="col">${t.outcome.name}</th>
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
              <td><${Outcome} session=${session} />${isSupervised(session) && html` <span class="small muted">${
                t.background.short}</span>`}</td>
            </tr>`)}
      </tbody>
    </table>
  </div>`;
