// Step 3: the camera is calculated from the good photos; the result, photo by photo, and what to do if it is poor.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { dateTime, fixed, number, percent } from '../format.js';
import { serviceLang, t } from '../texts.js';
import { jobIdOf, JobProgress } from '../parts/forms/job.js';
import { CameraWarnings } from '../parts/boxes/camera_warnings.js';
import { Notice, ProblemNotice } from '../parts/page/notice.js';
import { CellMap } from './coverage.js';
import { MIN_PHOTOS } from './photo_needs.js';
import { boardOf, goodPhotos } from './photos.js';
import { isPoor } from './steps.js';

const words = t.setup.calibration;

/** @param {Props} props */
export function CalibrationStep({ box, draft, stepHref, onChange }) {
  const [problem, setProblem] = useState(null);
  const [isSending, setSending] = useState(false);
  const { plan, photos } = draft;
  const good = goodPhotos(photos);
  const job = draft.job.calibration;
  const startCalibration = async () => {
    setSending(true);
    setProblem(null);
    try {
      draft.job.calibration = jobIdOf(await api.boxes.calibrate(box.id, formOf(plan, good)));
    } catch (error) {
      setProblem(asProblem(error));
    }
    setSending(false);
  };
  return html`
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <p>${words.with(good.length, photos.length, boardOf(plan), plan.square)}</p>
    ${!plan.measured && good.length >= MIN_PHOTOS && html`<${Notice} tone="warn" quiet title=${words.unmeasured(plan.square)}>
      <a href=${stepHref('board')}>${t.setup.photos.otherBoard}</a><//>
      <label class="check"><input type="checkbox" checked=${false} onInput=${() => draft.setPlan({ measured: true })} />
        ${t.setup.board.isMeasured(plan.square)}</label>`}
    ${good.length < MIN_PHOTOS && html`<p><a class="button" href=${stepHref('photos')}>${words.needPhotos(MIN_PHOTOS)}</a></p>`}
    <div class="row">
      <button class="button main" type="button" disabled=${good.length < MIN_PHOTOS || !plan.measured || isSending} onClick=${startCalibration}>
        ${isSending ? t.box.sending : words.begin(good.length)}</button>
    </div>
    ${job && html`<${JobProgress} key=${job} id=${job} done=${t.box.saved} onDone=${onChange} />`}
    ${box.camera && html`<${Result} camera=${box.camera} calibration=${box.calibration} photos=${photos} stepHref=${stepHref} />`}`;
}

function formOf(plan, good) {
  const form = new FormData();
  form.append('board', boardOf(plan));
  form.append('square_mm', String(plan.square));
  good.forEach(({ blob, name }) => form.append('photo', blob, name));
  return form;
}

function Result({ camera, calibration, photos, stepHref }) {
  const poor = isPoor(camera.rms_px);
  const left = (camera.photos ?? []).filter(({ used }) => !used);
  const isKnown = Number.isFinite(camera.rms_px);
  return html`
    <section class="stack" data-calibrated=${camera.calibrated_at}>
      <h3>${words.result}</h3>
      ${isKnown && html`<${Notice} tone=${poor ? 'warn' : 'good'} quiet title=${words.rms(number(camera.rms_px), poor)}>
        ${poor ? words.poor : words.fine}<//>`}
      <${CameraWarnings} calibration=${calibration} />
      ${!isKnown && html`<p class="muted">${words.given}</p>`}
      <dl class="facts">
        <dt>${t.box.when}</dt><dd>${dateTime(camera.calibrated_at)}</dd>
        <dt>${t.box.picture}</dt><dd>${camera.width} × ${camera.height}</dd>
        ${camera.square_mm && html`<dt>${words.board}</dt><dd>${words.boardOf(camera.board, number(camera.square_mm))}</dd>`}
        ${camera.coverage && html`<dt>${words.coverage}</dt><dd>${percent(camera.coverage.share)}</dd>`}
      </dl>
      ${(camera.coverage || camera.photos?.length > 0) && html`
        <div class="setup-two uneven">
          ${camera.photos?.length > 0 && html`<${Residuals} photos=${camera.photos} taken=${photos} />`}
          ${camera.coverage && html`<${CellMap} coverage=${camera.coverage} cells=${camera.coverage.corners}
            size=${camera} words=${words.map} />`}
        </div>`}
      ${left.length > 0 && html`<p class="small muted">${words.leftOut(left.length)}</p>`}
      ${poor && html`<ul class="bullets">${words.remedies.map(one => html`<li key=${one}>${one}</li>`)}</ul>
        <p><a class="button" href=${stepHref('photos')}>${words.again}</a></p>`}
    </section>`;
}

/** A bar for each photo: its residual relative to the largest. */
function Residuals({ photos, taken }) {
  const largest = Math.max(...photos.map(({ rms_px }) => rms_px ?? 0), 0.001);
  const urls = new Map(taken.map(({ name, url }) => [name, url]));
  return html`
    <div class="scroll" role="region" aria-label=${words.perPhoto} tabindex="0">
      <table class="table dense residuals">
        <caption class="small muted">${words.perPhoto}</caption>
        <thead><tr><th scope="col">${t.box.photo}</th><th scope="col" class="number">${t.box.residual}</th>
          <td></td><th scope="col">${t.box.reason}</th></tr></thead>
        <tbody>
          ${photos.map(({ file, used, rms_px, reason }) => html`
            <tr key=${file} data-used=${String(used)}>
              <th scope="row">${urls.has(file) && html`<img class="tiny" src=${urls.get(file)} alt="" />`} ${file}</th>
              <td class="number">${fixed(rms_px, 3)}</td>
              <td class="bars"><i class=${used ? '' : 'left'} style=${{ width: `${(100 * (rms_px ?? 0)) / largest}%` }}></i></td>
              <td>${used ? html`<span class="pill good">${t.box.used}</span>` : html`<span class="pill warn">${t.box.left}</span>
                <span class="small" lang=${serviceLang}>${reason}</span>`}</td>
            </tr>`)}
        </tbody>
      </table>
    </div>`;
}
