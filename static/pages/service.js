// The state of the service, and who changed what. For administrators.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData, usePages, useThrottled } from '../data.js';
import { bytes, dateTime } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { serviceLang, t } from '../texts.js';
import { Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { Prose } from '../parts/page/prose.js';

const words = t.service;
const DAY_MS = 86_400_000;
const LOW_BYTES = 5e9;
const OLD_DAYS = 7;
const PAGE = 25;

export default function Service() {
  const { data, problem, reload } = useData(signal => api.service(signal), []);
  const reloadSoon = useThrottled(reload, 5000);
  useLive('queue', reloadSoon);
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['centre'])}>${t.centre.title}</a>
      <a class="button" href=${href(['first-steps'])}>${t.firstSteps.title}</a><a class="button" href=${href(['people'])}>${words.tokens}</a><//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data && html`<div class="stack"><${Status} status=${data} /><${Audit} /></div>`}`;
}

const Facts = ({ title, rows, children }) => html`
  <section class="card"><header><h2>${title}</h2></header><div class="body stack">
    <dl class="facts">${rows.map(([name, value]) => html`<dt>${name}</dt><dd>${value}</dd>`)}</dl>${children}</div></section>`;

function Status({ status: { version, pipeline, started_at, storage, queue, last_backup: backup, scheduled_backups: plan, erasure_list_error, backup_command, retention, settings } }) {
  const days = backup ? Math.floor((Date.now() - Date.parse(backup.at)) / DAY_MS) : 0;
  return html`
    ${storage.free_bytes < LOW_BYTES && html`<${Notice} tone="warn" title=${words.low}>${words.lowBody}<//>`}
    <div class="columns">
      <${Facts} title=${words.versions} rows=${[[words.program, version], [words.pipeline, pipeline], [words.since, dateTime(started_at)]]} />
      <${Facts} title=${words.storage} rows=${[
        [words.files, words.filesOf(storage.files, bytes(storage.files_bytes))],
        [words.database, bytes(storage.database_bytes)],
        [words.free, bytes(storage.free_bytes)],
      ]} />
      <div class="stack"><${Facts} title=${words.backup} rows=${[
        [words.last, backup ? words.backupOf(dateTime(backup.at), words.backupAge(days), backup.files) : words.noBackup],
        ...(plan ? [[words.plan, words.planOf(plan.at, plan.keep)], [words.folder, plan.folder]] : []),
      ]}>
        ${plan?.error && html`<${Notice} tone="bad" title=${words.planFailed}>${plan.error}<//>`}
        ${erasure_list_error && html`<${Notice} tone="bad" title=${words.notListed}>${words.notListedBody}<br />${erasure_list_error}<//>`}
        ${plan && plan.others > 0 && html`<${Notice} tone="warn" title=${words.otherBackups(plan.others)}>${words.otherBackupsBody}<//>`}
        ${plan && plan.missing_files > 0 && html`<${Notice} tone="bad" title=${words.planLacks(plan.missing_files)}>
          <p>${words.planLacksBody}</p><ul lang=${serviceLang}>${plan.missing.map(one => html`<li key=${one}>${one}</li>`)}</ul><//>`}
        ${(!backup || days >= OLD_DAYS) && html`<${Notice} tone="warn" title=${backup ? words.backupAge(days) : words.noBackup}><${Prose} text=${words.noBackupBody} /><//>`}
        <p class="small">${words.byHand}</p><p class="code">${backup_command}</p><//>
      <${Facts} title=${words.queue} rows=${[[words.waiting, queue.queued], [words.running, queue.running], [words.quarantined, queue.quarantined]]} /></div>
      <${Facts} title=${words.retention} rows=${[
        [words.kept, retention.videos_months ? words.videosFor(retention.videos_months) : words.keptFor],
        ...(retention.videos_months ? [[words.nextVideos, words.videosOf(retention.next_videos, bytes(retention.next_bytes))]] : []),
        [words.erasedPeople, retention.erase_days ? words.erasedAfter(retention.erase_days) : words.erasedAtOnce],
        [words.accessLog, retention.access_log_months ? t.retention.months(retention.access_log_months) : words.keptFor],
        [t.waiting.keptTitle, t.waiting.keptDays(retention.unnamed_days)],
        [words.erased, words.within(settings.erased_within_s)],
        [words.unfinished, words.afterHours(settings.unfinished_upload_h)],
        [words.signIn, words.signInAfter(settings.idle_min, settings.sign_in_h)],
        [words.attempts, words.freeAttempts(settings.attempts_per_min)],
        [words.largest, bytes(settings.max_upload_bytes)],
        [words.workers, settings.workers],
      ]}><p class="small muted">${words.where}</p><//>
      <section class="card"><header><h2>${words.exports}</h2></header><div class="body stack">
        <p class="small muted">${words.exportsBody}</p>
        <p class="row"><a class="button" href=${api.dataAddress(false)} download>${t.ownData.save}</a>
          <a class="button" href=${api.dataAddress(true)} download>${t.ownData.saveWithVideos}</a></p></div></section>
    </div>`;
}

function Audit() {
  const { items, next, problem, busy, more } = usePages((cursor, signal) => api.audit({ limit: PAGE, cursor }, signal), []);
  return html`
    <section class="card">
      <header><h2>${words.audit}</h2></header>
      <p class="body small muted">${words.names}</p>
      <${ProblemNotice} problem=${problem} onRetry=${more} />
      ${!items && !problem && html`<${Loading} />`}
      ${items?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${items && items.length > 0 && html`<div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.when}</th><th scope="col">${words.who}</th><th scope="col">${words.address}</th>
          <th scope="col">${words.what}</th><th scope="col">${words.which}</th></tr></thead>
        <tbody>${items.map(one => html`<tr key=${one.id}>
          <td class="when">${dateTime(one.at)}</td><td>${one.who ?? words.by[one.by] ?? one.by}</td><td>${one.address ?? '–'}</td>
          <td>${words.change(one.action, one.noun, one.attempt)}${one.why && html`<p class="said small">${one.why}</p>`}</td><td class=${one.called === null && 'code'} title=${one.subject}>${subject(one)}</td></tr>`)}</tbody>
      </table></div>`}
      ${next && html`<div class="pager"><button class="button" type="button" aria-disabled=${busy} onClick=${more}>
        ${busy ? t.loading : words.more}</button></div>`}
    </section>`;
}

const PAGES = { trainee: 'trainees', session: 'sessions', task: 'tasks', box: 'boxes', group: 'groups' };

/**
 * A link if the object has a page and this change did not delete it.
 *
 * @param {Schemas['AuditChange']} change
 */
function subject({ noun, action, subject: id, called }) {
  const page = PAGES[noun];
  const isDeleted = ['erase', 'delete'].includes(action);
  return page && !isDeleted ? html`<a href=${href([page, id])}>${called ?? id}</a>` : called ?? id;
}
