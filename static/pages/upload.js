// Upload: choose trainee, task and box, then drop or pick files. The uploads run in parts/recording/uploads.js and
// continue after this page is left.
import { html, useEffect, useRef, useState } from '../preact.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { icons } from '../parts/page/icons.js';
import { ImportTable } from '../parts/recording/import_table.js';
import { Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { UploadList } from '../parts/recording/upload_list.js';
import { isBoxReady, maySendRecordings, RecordingTargetFields, TargetNeeded, useRecordingTarget } from '../parts/recording/recording_target.js';
import { addFiles, onUploads, setUploader, uploads } from '../parts/recording/uploads.js';

const words = t.upload;
const ACCEPT = 'video/*,.mp4,.mov,.mkv,.webm,.avi,.ts,.m4v';

/** @param {Props} props */
export default function UploadPage({ person, route }) {
  const target = useRecordingTarget({ person, route });
  const [items, setItems] = useState(uploads);
  useEffect(() => {
    const unsubscribe = onUploads(() => setItems(uploads()));
    setUploader(person.id);
    setItems(uploads());
    return unsubscribe;
  }, [person.id]);

  if (!maySendRecordings(person))
    return html`<${PageHead} title=${words.title} /><${Notice} tone="warn" title=${t.target.noTrainee} />`;
  return html`
    <${PageHead} title=${words.title} lead=${words.lead} />
    <${ProblemNotice} problem=${target.problem} onRetry=${target.reload} />
    ${!target.lists && !target.problem && html`<${Loading} />`}
    ${target.lists && html`<${Target} target=${target} mayRetime=${may(person, 'edit_sessions')} />`}
    <section class="card list">
      <header><h2>${words.list}</h2></header>
      ${items.length ? html`<${UploadList} items=${items} namesOf=${target.namesOf} />`
        : html`<${Empty} title=${words.none} body=${words.noneBody} />`}
    </section>
    ${may(person, 'see_trainees') && html`<p class="small stack after"><a href=${href(['waiting'])}>${t.waiting.fromUpload}</a></p>`}
    ${target.lists && may(person, 'upload') && html`<${ImportTable} target=${target} />`}`;
}

function Target({ target, mayRetime }) {
  const when = useRef(null);
  const [rate, length] = [useRef(null), useRef(null)];
  const [filesRefused, setFilesRefused] = useState(false);
  const take = files => {
    if (!target.ids) return setFilesRefused(true);
    setFilesRefused(false);
    const recorded = when.current.value && new Date(when.current.value).toISOString();
    const given = { recorded_at: recorded, true_frame_rate_hz: rate.current?.value, true_duration_s: length.current?.value };
    addFiles([...files], { ...target.ids, ...Object.fromEntries(Object.entries(given).filter(([, text]) => text)) });
    return undefined;
  };
  return html`
    <section class="card">
      <div class="body stack">
        <div class="fields">
          <${RecordingTargetFields} target=${target} />
          <${Field} type="datetime-local" label=${words.when} hint=${words.whenHint} inputRef=${when} />
        </div>
        ${target.chosen.box && !isBoxReady(target.chosen.box) && html`<${Notice} tone="warn" title=${t.record.unready}>${
          words.unready}${' '}<a href=${href(['boxes', target.chosen.box.id])}>${t.record.toBox}</a><//>`}
        ${mayRetime && html`<details class="small">
          <summary>${words.time}</summary>
          <p class="muted">${words.timeHint}</p>
          <div class="fields">
            <${Field} type="number" step="any" min="1" max="1000" label=${words.trueRate} inputRef=${rate} />
            <${Field} type="number" step="any" min="0.1" max="86400" label=${words.trueLength} hint=${words.trueLengthHint}
              inputRef=${length} />
          </div>
        </details>`}
        <${Drop} onFiles=${take} />
        ${filesRefused && !target.ids && html`<${TargetNeeded} refused=${target.refused} />`}
      </div>
    </section>`;
}

function Drop({ onFiles }) {
  const [over, setOver] = useState(false);
  const input = useRef(null);
  const stop = (event, state) => {
    event.preventDefault();
    setOver(state);
  };
  const drop = event => {
    stop(event, false);
    onFiles(event.dataTransfer.files);
  };
  const picked = () => {
    onFiles(input.current.files);
    input.current.value = ''; // Lets the same file be chosen again.
  };
  return html`
    <div class=${`drop ${over ? 'over'
      : ''}`} onDragEnter=${event => stop(event, true)} onDragOver=${event => stop(event, true)}
      onDragLeave=${event => stop(event, false)} onDrop=${drop}>
      <${icons.upload} size=${36} />
      <div><strong>${words.drop}</strong><p class="muted">${words.or}</p></div>
      <label class="button main"><input ref=${input} type="file" multiple accept=${ACCEPT} onChange=${picked} />
        ${words.pick}</label>
    </div>`;
}
