// The camera and its picture; what prevents a recording, and what to do about it.
import { html } from '../../preact.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { uncontrolledModes } from '../../record/camera.js';
import { Field } from '../forms/form.js';
import { icons } from '../page/icons.js';
import { Notice } from '../page/notice.js';
import { isBoxReady } from './recording_target.js';

const words = t.record;
const SIZES = ['1920x1080', '1280x720', '640x480'];
const RATES = ['60', '30', '25', '15'];

export function CameraFields({ camera: { list, chosen, choose, stream }, calibrated }) {
  const { deviceId: inUse, width, height } = stream?.getVideoTracks()[0].getSettings() ?? {};
  const actualSize = stream && `${width}x${height}`;
  const calibratedSize = calibrated && `${calibrated.width}x${calibrated.height}`;
  const sizes = [...new Set([calibratedSize, chosen.size, ...SIZES].filter(Boolean))];
  return html`
    <${Field} type="select" label=${words.camera} value=${inUse ?? chosen.camera} disabled=${!stream}
      options=${list.length ? list.map(({ id, name }) => [id, name]) : [['', words.noneYet]]}
      onInput=${event => choose({ camera: event.target.value })} />
    <${Field} type="select" label=${words.size} value=${chosen.size} options=${sizes.map(size => [size, sizeText(size)])}
      hint=${hintOf({ actualSize, calibratedSize, wanted: chosen.size })}
      onInput=${event => choose({ size: event.target.value })} />
    <${Field} type="select" label=${words.rate} value=${chosen.rate}
      options=${RATES.map(rate => [rate, words.perSecond(rate)])}
      onInput=${event => choose({ rate: event.target.value })} />`;
}

/** Says that the picture is not as chosen, or which size fits the calibration. */
function hintOf({ actualSize, calibratedSize, wanted }) {
  if (actualSize && actualSize !== wanted) return words.gives(sizeText(actualSize));
  return calibratedSize && words.fitting(sizeText(calibratedSize));
}

const sizeText = size => size.replace('x', '\u00a0×\u00a0');

/** What would spoil a recording with this camera in this box. @param {Props} props */
export function CameraNotices({ camera: { stream }, calibrated, box, person }) {
  const track = stream?.getVideoTracks()[0];
  const { width, height } = track?.getSettings() ?? {};
  const differs = calibrated && track && (width !== calibrated.width || height !== calibrated.height);
  const uncontrolled = track ? uncontrolledModes(track) : [];
  const link = box && may(person, 'see_boxes') && html` <a href=${href(['boxes', box.id])}>${words.toBox}</a>`;
  return html`
    ${box && !isBoxReady(box) && html`<${Notice} tone="warn" title=${words.unready}>${words.unreadyBody}${link}<//>`}
    ${differs && html`<${Notice} tone="warn"
      title=${words.otherSize(sizeText(`${width}x${height}`), sizeText(`${calibrated.width}x${calibrated.height}`))}>
      ${words.otherSizeBody}${link}<//>`}
    ${track && uncontrolled.length > 0 && html`<${Notice} tone="warn" title=${words.unheld(uncontrolled)}>${words.unheldBody}<//>`}
    ${track && uncontrolled.length === 0 && html`<p class="small muted">${words.held}</p>`}`;
}

/** Shown instead of the picture while the camera is off: why, and what to do. */
export function CameraOff({ camera: { fault, isOpening, turnOn } }) {
  const { title, body, again } = words.faults[fault] ?? { title: words.off, body: words.offBody, again: words.turnOn };
  return html`
    <div class="screen own off" role=${fault ? 'alert' : undefined}>
      <div class="stack tight">
        <${fault ? icons.warning : icons.camera} size=${36} />
        <strong>${isOpening ? words.opening : title}</strong>
        ${!isOpening && html`<p>${body}</p>`}
        ${!isOpening && html`<p class="row">
          ${again && html`<button class="button main" type="button" onClick=${turnOn}>${again}</button>`}
          ${fault && html`<a class="button" href=${href(['upload'])}>${t.today.upload}</a>`}</p>`}
      </div>
    </div>`;
}
