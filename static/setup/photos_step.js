// Step 2: photos of the board, from this device's camera or from files. Each is judged at once, while the board is at
// hand.
import { html, useEffect, useRef, useState } from '../preact.js';
import { api, Problem } from '../api.js';
import { asProblem } from '../data.js';
import { t } from '../texts.js';
import { focusSoon } from '../parts/forms/focus.js';
import { Field } from '../parts/forms/form.js';
import { jobIdOf, JobProgress } from '../parts/forms/job.js';
import { Announce, Notice, ProblemNotice } from '../parts/page/notice.js';
import { watchBoard } from './auto_photos.js';
import { CoverageMap } from './coverage.js';
import { needsOf, TILTS } from './photo_needs.js';
import { PhotoCard } from './photo_card.js';
import { addChecked, addPhotos, boardOf, checkPicture, goodPhotos, removePhoto, retry, usualSize } from './photos.js';
import { CameraShot } from './camera_shot.js';

const words = t.setup.photos;

/** @param {Props} props */
export function PhotosStep({ box, draft, stepHref, onChange }) {
  const [problem, setProblem] = useState(null);
  const { photos, plan } = draft;
  const add = files => (setProblem(null), addPhotos(draft, box.id, files, setProblem));
  const auto = useAutoPhotos(draft, box, setProblem);
  const choose = event => {
    add([...event.target.files]);
    event.target.value = '';
  };
  const remove = photo => (setProblem(null), removePhoto(draft, photo), focusSoon('photos-so-far', 'setup-step'));
  const good = goodPhotos(photos);
  const size = usualSize(photos.filter(({ check }) => check?.found));
  const latest = [...photos].reverse().find(({ state }) => state === 'checked' || state === 'failed');
  return html`
    <p class="small muted">${words.withBoard(boardOf(plan), plan.square)} <a href=${stepHref('board')}>${words.otherBoard}</a></p>
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <div class="setup-two">
      <div class="stack">
        <${CameraShot} calibrated=${box.calibration} label=${words.take} onShot=${blob => add([blob])} auto=${auto} />
        <p class="small muted">${words.auto.hint}</p>
        <${Field} type="file" label=${words.choose} hint=${words.chooseHint} accept="image/*" multiple onInput=${choose} />
        <${BoardVideo} box=${box} draft=${draft} stepHref=${stepHref} onProblem=${setProblem} onChange=${onChange} />
      </div>
      <${Needs} good=${good} taken=${photos.length} />
    </div>
    <${Announce}>${latest ? words.heard(latest) : ''}<//>
    ${photos.length > 0 && html`
      <section class="stack">
        <h3 id="photos-so-far" tabindex="-1">${words.sofar(good.length, photos.length)}</h3>
        <ul class="photos">
          ${[...photos].reverse().map(photo => html`
            <${PhotoCard} key=${photo.id} photo=${photo} usual=${size} onRemove=${() => remove(photo)}
              onRetry=${() => retry(draft, box.id, photo)} />`)}
        </ul>
      </section>`}`;
}

/** Photos that the page takes by itself while it is open. @param {object} draft @param {Props['box']} box */
function useAutoPhotos(draft, box, onProblem) {
  const [says, setSays] = useState('');
  const running = useRef(null);
  const stop = () => {
    running.current?.abort();
    running.current = null;
    setSays('');
  };
  useEffect(() => () => running.current?.abort(), []);
  const toggle = async frame => {
    if (running.current) return stop();
    const { signal } = (running.current = new AbortController());
    onProblem(null);
    setSays(words.auto.says.search);
    try {
      await watchBoard({
        signal,
        taken: () => goodPhotos(draft.photos).map(({ check }) => check),
        look: async () => {
          const blob = await frame();
          return blob && { blob, check: await checkPicture(draft, box.id, blob, 'look.png') };
        },
        onVerdict: async (verdict, blob, check) => {
          setSays(words.auto.says[verdict]);
          if (verdict !== 'take') return;
          await addChecked(draft, blob, check);
          if (needsOf(goodPhotos(draft.photos)).isEnough) stop();
        },
      });
    } catch (error) {
      onProblem(asProblem(error));
      stop();
    }
    return undefined;
  };
  return { label: words.auto.start, stop: words.auto.stop, isOn: Boolean(says), toggle, count: goodPhotos(draft.photos).length, says };
}

/** A video of the board in place of photos: the camera is calibrated from it at once. @param {Props} props */
function BoardVideo({ box, draft, stepHref, onProblem, onChange }) {
  const [busy, setBusy] = useState(false);
  const { plan } = draft;
  const job = draft.job.video;
  const send = async event => {
    const [file] = event.target.files;
    if (!file) return;
    onProblem(null);
    if (file.type.startsWith('image/')) return onProblem(new Problem({ title: words.video.isPhoto, status: 0, detail: '' }));
    setBusy(true);
    const form = new FormData();
    form.append('board', boardOf(plan));
    form.append('square_mm', String(plan.square));
    form.append('video', file, file.name);
    try {
      draft.job.video = jobIdOf(await api.boxes.calibrate(box.id, form));
    } catch (error) {
      onProblem(asProblem(error));
    }
    event.target.value = '';
    setBusy(false);
    return undefined;
  };
  return html`
    <details>
      <summary>${words.video.title}</summary>
      <div class="stack tight">
        ${plan.measured ? html`<${Field} type="file" label=${words.video.choose} hint=${words.video.hint} accept="video/*" disabled=${busy} onInput=${send} />`
          : html`<${Notice} tone="warn" quiet title=${t.setup.calibration.unmeasured(plan.square)}>
              <a href=${stepHref('board')}>${words.video.measure}</a><//>`}
        ${busy && html`<p role="status">${t.box.sending}</p>`}
        ${job && html`<${JobProgress} key=${job} id=${job} done=${t.box.saved} onDone=${onChange} />
          <p class="small"><a href=${stepHref('calibration')}>${words.video.result}</a></p>`}
      </div>
    </details>`;
}

/** What the next photo should show. */
function Needs({ good, taken }) {
  const needs = needsOf(good);
  if (good.length === 0)
    return html`<div class="stack"><h3>${words.how}</h3>
      <ul class="bullets">${words.hints.map(hint => html`<li key=${hint}>${hint}</li>`)}</ul>
      ${taken > 0 && html`<${Notice} tone="warn" quiet title=${words.noneGood} />`}</div>`;
  return html`
    <div class="stack">
      <h3>${words.next}</h3>
      <${CoverageMap} needs=${needs} photos=${good} />
      <ul class="bullets">
        ${needs.missing.length > 0 && html`<li>${words.missing(needs.missing)}</li>`}
        ${needs.untilted.length > 0 && html`<li>${words.untilted(needs.untilted)}</li>`}
        ${needs.more > 0 && html`<li>${words.more(needs.more)}</li>`}
        ${needs.isEnough && html`<li>${words.enough}</li>`}
      </ul>
      <dl class="facts small">${TILTS.map(side => html`<dt key=${side}>${words.tilted[side]}</dt>
        <dd>${words.count(needs.tilts[side])}</dd>`)}</dl>
      <p class="small muted">${words.rough}</p>
    </div>`;
}
