// Recordings that wait for a name: look at them, say whose they are, many at once.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData, usePages } from '../data.js';
import { date } from '../format.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Confirm, Dialog } from '../parts/forms/dialog.js';
import { Field } from '../parts/forms/form.js';
import { Announce, Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { reloadWaitingCount } from '../parts/waiting/waiting_count.js';
import { firstChoice, KINDS, WaitingRow } from '../parts/waiting/waiting_row.js';

const words = t.waiting;
const PAGE = 50;
const SOURCES = ['agent', 'inbox', 'upload'];

/** The groups of the list: one for each day and box, in the order of the list. */
function groupsOf(items) {
  const groups = new Map();
  for (const item of items) {
    const key = `${date(item.recorded_at ?? item.arrived_at)} · ${item.box?.name ?? words.noBox}`;
    groups.set(key, [...(groups.get(key) ?? []), item]);
  }
  return [...groups];
}

/** @param {Props} props */
export default function Waiting({ route }) {
  const filter = { box: route.query.get('box') || undefined, source: /** @type {any} */ (route.query.get('source') || undefined) };
  const lists = useData(async signal => {
    const [trainee, task, box, count] = await Promise.all([api.trainees.all(), api.tasks.all(), api.boxes.all(), api.waiting.count(signal)]);
    return { trainee, task, box, count };
  }, []);
  const [round, setRound] = useState(0);
  const pages = usePages((cursor, signal) => api.waiting.page({ ...filter, limit: PAGE, cursor }, signal), [filter.box, filter.source, round]);
  const problem = lists.problem ?? pages.problem;
  const reload = () => {
    lists.reload();
    setRound(number => number + 1);
    reloadWaitingCount();
  };
  const set = name => event => replace(['waiting'], { ...filter, [name]: event.target.value });
  return html`
    <${PageHead} title=${words.title} lead=${lists.data ? words.lead(lists.data.count.kept_days) : ''} />
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${(!lists.data || !pages.items) && !problem && html`<${Loading} />`}
    ${lists.data && pages.items && html`
      <section class="card">
        <div class="filters" role="search" aria-label=${words.title}>
          <${Field} type="select" label=${t.target.box} value=${filter.box} options=${[['', t.sessions.any],
            ...lists.data.box.map(one => [one.id, one.name])]} onInput=${set('box')} />
          <${Field} type="select" label=${words.source} value=${filter.source} options=${[['', t.sessions.any],
            ...SOURCES.map(name => [name, words.sources[name]])]} onInput=${set('source')} />
        </div>
        <${WaitingList} items=${pages.items} next=${pages.next} more=${pages.more} lists=${lists.data} onChanged=${reload} />
      </section>`}`;
}

/** @param {Props} props */
function WaitingList({ items, next, more, lists, onChanged }) {
  const [choices, setChoices] = useState(/** @type {Record<string, any>} */ ({}));
  const [chosen, setChosen] = useState(/** @type {string[]} */ ([]));
  const [problems, setProblems] = useState(/** @type {Record<string, any>} */ ({}));
  const [done, setDone] = useState(/** @type {any[]} */ ([]));
  const [playing, setPlaying] = useState(null);
  const choiceOf = item => choices[item.id] ?? firstChoice(item);
  const put = (ids, change) => setChoices(before => {
    const changed = items.filter(item => ids.includes(item.id)).map(item => [item.id, { ...(before[item.id] ?? firstChoice(item)), ...change }]);
    return { ...before, ...Object.fromEntries(changed) };
  });
  const picked = items.filter(item => chosen.includes(item.id));
  const pick = (ids, isChosen) => setChosen(before => [...before.filter(id => !ids.includes(id)), ...(isChosen ? ids : [])]);
  const ended = (results, names) => {
    const made = results.filter(one => one.session);
    setDone(made.map(one => ({ ...one, name: names[one.id] })));
    setProblems(Object.fromEntries(results.filter(one => one.problem).map(one => [one.id, one.problem])));
    pick(made.map(one => one.id), false);
    onChanged();
  };
  return html`
    <${Announce}>${done.length ? words.assigned(done.length) : ''}<//>
    ${done.length > 0 && html`<div class="body"><${Notice} tone="good" title=${words.assigned(done.length)}>
      <ul>${done.map(one => html`<li key=${one.id}><a href=${href(['sessions', one.session])}>${one.name}</a>${
        one.waits_for_box && ` – ${words.waitsForBox}`}</li>`)}</ul><//></div>`}
    ${items.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
    ${items.length > 0 && html`<${Actions} picked=${picked} choiceOf=${choiceOf} lists=${lists}
      onSet=${(kind, value) => put(picked.map(item => item.id), { [kind]: value })} onEnded=${ended} onChanged=${onChanged}
      isAll=${picked.length === items.length} onPickAll=${isChosen => pick(items.map(item => item.id), isChosen)} />`}
    ${groupsOf(items).map(([title, group]) => html`
      <div class="scroll" key=${title}><table class="table waiting">
        <caption><h2>${title}</h2></caption>
        <thead><tr><th scope="col"><span class="unseen">${words.chosen}</span></th><th scope="col">${words.picture}</th>
          <th scope="col">${words.recording}</th>${KINDS.map(kind => html`<th scope="col" key=${kind}>${t.target[kind]}</th>`)}</tr></thead>
        <tbody>${group.map(item => html`<${WaitingRow} key=${item.id} item=${item} lists=${lists} choice=${choiceOf(item)}
          isChosen=${chosen.includes(item.id)} problem=${problems[item.id]} onChoose=${isChosen => pick([item.id], isChosen)}
          onSet=${(kind, value) => put([item.id], { [kind]: value })} onPlay=${() => setPlaying(item)} />`)}</tbody>
      </table></div>`)}
    ${next && html`<div class="more"><button class="button" type="button" onClick=${more}>${t.sessions.more}</button></div>`}
    ${playing && html`<${Dialog} title=${playing.filename} onClose=${() => setPlaying(null)}>
      <video controls autoplay muted playsinline class="waiting-video" src=${api.waiting.videoAddress(playing.id)}></video>
      <p class="small muted">${words.playHint}</p>
      <div class="actions"><button class="button" type="button" onClick=${() => setPlaying(null)}>${t.form.close}</button></div><//>`}`;
}

/** What is done with the chosen recordings. @param {Props} props */
function Actions({ picked, choiceOf, lists, onSet, onEnded, onChanged, isAll, onPickAll }) {
  const [isBusy, setBusy] = useState(false);
  const [isSeen, setSeen] = useState(false);
  const [problem, setProblem] = useState(null);
  const [isDiscarding, setDiscarding] = useState(false);
  // With other recordings chosen, the selects begin anew: what they showed was set for the ones before.
  const ids = picked.map(item => item.id).join();
  const ready = picked.filter(item => KINDS.every(kind => choiceOf(item)[kind]));
  const assign = async () => {
    setBusy(true);
    setProblem(null);
    const names = Object.fromEntries(ready.map(item => [item.id, item.filename]));
    try {
      const { results } = await api.waiting.assign(ready.map(item => ({ id: item.id, ...choiceOf(item), supervised: isSeen })));
      setSeen(false); // It is said about these recordings only.
      onEnded(results, names);
    } catch (error) {
      setProblem(asProblem(error));
    }
    setBusy(false);
  };
  const discard = async () => {
    for (const item of picked) await api.waiting.discard(item.id);
    onChanged();
  };
  return html`
    <div class="body stack waiting-actions">
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <label class="check"><input type="checkbox" checked=${isAll} onInput=${event => onPickAll(event.target.checked)} />${words.pickAll}</label>
      <fieldset class="plain" disabled=${picked.length === 0}>
        <legend>${words.setAll(picked.length)}</legend>
        <div class="fields">${KINDS.map(kind => html`<${Field} key=${`${kind} ${ids}`} type="select" label=${t.target[kind]} value=""
          options=${[['', words.unchanged], ...lists[kind].map(one => [one.id, one.name])]}
          onInput=${event => event.target.value && onSet(kind, event.target.value)} />`)}</div>
        <label class="check"><input type="checkbox" checked=${isSeen} onInput=${event => setSeen(event.target.checked)} />${words.seen}</label>
      </fieldset>
      ${picked.length > ready.length && html`<p class="small warn-text">${words.incomplete(picked.length - ready.length)}</p>`}
      <div class="row">
        <button class="button main" type="button" disabled=${isBusy || ready.length === 0} onClick=${assign}>${
          isBusy ? words.assigning : words.assign(ready.length)}</button>
        <button class="button" type="button" disabled=${picked.length === 0} onClick=${() => setDiscarding(true)}>${
          words.discard(picked.length)}</button>
      </div>
    </div>
    ${isDiscarding && html`<${Confirm} title=${words.discardTitle(picked.length)} body=${words.discardBody} yes=${words.discard(picked.length)}
      onYes=${discard} onClose=${() => setDiscarding(false)} />`}`;
}
