// Enrols many people from a table: read here, checked by the service, shown row by row; then all are enrolled, or none. The
// groups that are missing and the accounts are made with them.
import { html, useEffect, useRef, useState } from '../preact.js';
import { api } from '../api.js';
import { decodeFile, parseRows } from '../csv.js';
import { asProblem, useData } from '../data.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { fieldErrorText } from '../translate.js';
import { Field } from '../parts/forms/form.js';
import { Announce, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { MadeInvitations } from '../parts/people/invitations.js';

const words = t.enrol;
const FIELDS = Object.keys(words.columns);

/** @param {Props} props */
export default function Enrol({ route }) {
  const { data: groups } = useData(() => api.groups.all(), []);
  const [checked, setChecked] = useState(null);
  const [enrolled, setEnrolled] = useState(null);
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(null);
  const changeCount = useRef(0); // Counts changes of the input: an answer about an earlier input is discarded.
  const run = async (what, work) => {
    setBusy(what);
    setProblem(null);
    await work().catch(error => setProblem(asProblem(error)));
    setBusy(null);
  };
  const check = (text, { group, isNew, invite }) => run('check', async () => {
    setChecked(null);
    const countAtStart = changeCount.current;
    const table = read(await text, group);
    const options = { only_check: true, make_groups: true, invite };
    const { problems, new_groups: newGroups } = table.rows ? await api.enrol(table.rows, options) : { problems: [], new_groups: [] };
    if (countAtStart === changeCount.current) setChecked({ ...table, problems, newGroups, invite, groupToMake: isNew ? group : null });
  });
  const change = () => {
    changeCount.current += 1;
    setChecked(null);
  };
  const enrol = () => run('enrol', async () => {
    const options = { only_check: false, make_groups: checked.newGroups.length > 0, invite: checked.invite };
    setEnrolled(await api.enrol(checked.rows, options));
  });
  useEffect(() => void (enrolled && /** @type {HTMLElement} */ (document.querySelector('main h1')).focus()), [enrolled]);
  const announcement = enrolled ? words.done(enrolled.enrolled.length) : checked ? summaryOf(checked) : '';
  return html`
    <${Announce}>${announcement}<//>
    ${enrolled ? html`<${Done} outcome=${enrolled} />` : html`
      <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['groups'])}>${t.groups.all}</a><//>
      <div class="stack">
        <${Source} groups=${groups ?? []} wanted=${route.query.get('group')} busy=${busy === 'check'} onCheck=${check}
          onChange=${change} />
        <${ProblemNotice} problem=${problem} />
        ${checked && html`<${CheckResult} checked=${checked} busy=${busy === 'enrol'} onEnrol=${enrol} />`}
      </div>`}`;
}

/** The choice of a group that does not exist yet; no group has this name, since names are trimmed. */
const NEW_GROUP = ' ';

function Source({ groups, wanted, busy, onCheck, onChange }) {
  const [file, text, newGroup] = [useRef(null), useRef(null), useRef(null)];
  const [groupName, setGroupName] = useState(wanted ?? '');
  const [invite, setInvite] = useState(true);
  const submit = event => {
    event.preventDefault();
    const [chosen] = file.current.files;
    const isNew = groupName === NEW_GROUP;
    const group = isNew ? newGroup.current.value.trim() : groupName;
    onCheck(chosen ? decodeFile(chosen) : text.current.value, { group, isNew, invite });
  };
  const chooseGroup = event => (setGroupName(event.target.value), onChange());
  const chooseInvite = event => (setInvite(event.target.checked), onChange());
  const pick = () => ((text.current.value = ''), onChange());
  const type = () => ((file.current.value = ''), onChange());
  return html`
    <form class="card" onSubmit=${submit}><div class="body stack">
      <div class="fields">
        <${Field} type="file" label=${words.file} hint=${words.fileHint} accept=".csv,.tsv,.txt,text/csv" inputRef=${file} onInput=${pick} />
        <${Field} type="select" label=${words.group} value=${groupName} onInput=${chooseGroup}
          options=${[['', words.noGroup], ...groups.map(one => [one.name, one.name]), [NEW_GROUP, words.newGroup]]} key=${groups.length} />
        ${groupName === NEW_GROUP && html`<${Field} label=${words.newGroupName} required maxlength="120" inputRef=${newGroup} onInput=${onChange} />`}
      </div>
      <${Field} type="textarea" label=${words.paste} inputRef=${text} onInput=${type} spellcheck=${false} />
      <div class="field"><label class="check"><input type="checkbox" checked=${invite} onChange=${chooseInvite} />${words.invite}</label>
        <p class="hint">${words.inviteHint}</p></div>
      <div class="row">
        <button class="button main" type="submit" disabled=${busy}>${busy ? words.looking : words.look}</button>
        <a class="button" download=${words.exampleName} href=${`data:text/csv;charset=utf-8,${encodeURIComponent(words.exampleText)}`}>
          ${words.example}</a>
      </div>
    </div></form>`;
}

/** The rows as the REST API takes them; or `why` there are none. */
function read(text, group) {
  const [head, ...lines] = parseRows(text);
  const headers = (head ?? []).map(name => name.toLowerCase());
  const columns = Object.fromEntries(FIELDS.map(field => [field, headers.findIndex(name => words.headers[field].includes(name))]));
  const unknown = (head ?? []).filter((name, at) => name && !Object.values(columns).includes(at));
  if (columns.name < 0) return { why: words.noName };
  if (!lines.length) return { why: words.noRows };
  const toRow = line => Object.fromEntries(FIELDS.map(field => [field, codeOf(field, line[columns[field]] ?? '')]));
  const rows = lines.map(toRow).map(row => ({ ...row, group: row.group || group }));
  return { rows, unknown };
}

/**
 * A table may name levels and hands as these pages do. The REST API takes codes, which are the English words: tables in
 * English work everywhere.
 */
const CODES = { level: t.trainees.levels, handedness: t.trainees.hands };
const codeOf = (field, cell) =>
  Object.entries(CODES[field] ?? {}).find(names => names.some(name => name.toLowerCase() === cell.toLowerCase()))?.[0] ?? cell;
const wordsOf = (field, cell) => CODES[field]?.[cell] ?? cell;

const wrongRows = ({ problems }) => new Set(problems.map(problem => problem.row)).size;

/** The result of a check in one sentence. */
function summaryOf(checked) {
  const wrong = checked.why ? 0 : wrongRows(checked);
  return checked.why ?? (wrong ? words.problems(wrong, checked.rows.length) : words.count(checked.rows.length));
}

function CheckResult({ checked, busy, onEnrol }) {
  const { why, rows, unknown, problems, newGroups, groupToMake, invite } = checked;
  const [agreed, setAgreed] = useState(false);
  if (why) return html`<${Notice} tone="warn" quiet title=${why} />`;
  const wrong = wrongRows(checked);
  // A group that only the table names may be a typing mistake; the one of the form was asked for.
  const toConfirm = newGroups.filter(name => name !== groupToMake);
  const isHeld = toConfirm.length > 0 && !agreed;
  return html`
    <section class="card">
      <header><h2>${words.result}</h2>${wrong === 0 && html`<button class="button main" type="button" disabled=${busy || isHeld} onClick=${onEnrol}>
        ${busy ? words.enrolling : words.enrol(rows.length)}</button>`}</header>
      <div class="body stack">
        <${Notice} tone=${wrong || isHeld ? 'warn' : 'good'} quiet title=${!wrong && isHeld ? words.confirmGroups(toConfirm.length) : summaryOf(checked)} />
        ${unknown.length > 0 && html`<p class="muted">${words.unknownColumns(unknown)}</p>`}
        ${toConfirm.length > 0 && html`<div class="field"><label class="check"><input type="checkbox" checked=${agreed}
          onChange=${event => setAgreed(event.target.checked)} />${words.makeGroups(toConfirm.length, toConfirm.join(', '))}</label><p class="hint">${words.makeGroupsHint}</p></div>`}
      </div>
      <div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.row}</th>${FIELDS.map(field => html`<th key=${field} scope="col">${words.columns[field]}</th>`)}
          <th scope="col">${words.result}</th></tr></thead>
        <tbody>${rows.map((row, at) => html`<${Row} key=${at} number=${at + 1} row=${row} isNew=${newGroups.includes(row.group.trim())} invite=${invite} problems=${problems.filter(one => one.row === at + 1)} />`)}</tbody>
      </table></div>
    </section>`;
}

/** What the service makes of an empty cell. */
const madeOf = (field, invite) => (field === 'code' ? words.made : field === 'login' && invite ? words.madeOfCode : '–');

/** What is wrong with a cell. @param {Props} props */
function CellError({ error }) {
  const { text, lang } = fieldErrorText(error);
  return html`<span lang=${lang}>${text}</span>`;
}

const Row = ({ number, row, isNew, invite, problems }) => html`
  <tr class=${problems.length ? 'wrong' : ''}>
    <th scope="row" class="short">${number}</th>
    ${FIELDS.map(field => html`<td key=${field} class=${row[field] ? '' : 'muted'}>
      ${wordsOf(field, row[field]) || madeOf(field, invite)}${field === 'group' && isNew && html` <span class="pill">${words.willBeMade}</span>`}</td>`)}
    <td>${problems.length ? html`<ul class="row-problems">${problems.map(problem => html`<li key=${problem.field}>
      ${words.columns[problem.field]}: <${CellError} error=${problem} /></li>`)}</ul>` : words.fine}</td>
  </tr>`;

/** @param {{ outcome: Schemas['EnrolmentOutcome'] }} props */
const Done = ({ outcome: { enrolled, invitations } }) => html`
  <${PageHead} title=${words.title}><a class="button" href=${href(['groups'])}>${words.back}</a><//>
  <div class="stack">
    <${Notice} tone="good" quiet title=${words.done(enrolled.length)} />
    ${invitations.length > 0 ? html`<${MadeInvitations} invitations=${invitations} />` : html`
      <section class="card"><header><h2>${words.who}</h2><a class="button" href=${href(['invite'])}>${t.invitations.open}</a></header>
        <ul class="queue">${enrolled.map(one => html`<li key=${one.id}><div><a href=${href(['trainees', one.id])}>${one.name}</a>
          <span class="code">${one.code}</span></div></li>`)}</ul></section>`}
  </div>`;
