// Whether several people use this device, and when it signs out a person who forgot to.
import { html, useEffect, useState } from '../../preact.js';
import { IDLE_CHOICES_MIN, onSharedChange, setShared, sharedIdleMinutes } from '../../shared_device.js';
import { t } from '../../texts.js';
import { Field } from '../forms/form.js';

const words = t.shared;

export function SharedDevice() {
  const [minutes, setMinutes] = useState(sharedIdleMinutes);
  useEffect(() => onSharedChange(() => setMinutes(sharedIdleMinutes())), []);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <label class="check"><input type="checkbox" checked=${minutes > 0} onInput=${event => setShared(event.target.checked)} />
          ${words.is}</label>
        <p class="small muted">${words.hint}</p>
        ${minutes > 0 && html`<${Field} type="select" label=${words.idle} value=${String(minutes)}
          options=${IDLE_CHOICES_MIN.map(one => [String(one), words.minutes(one)])}
          onInput=${event => setShared(true, Number(event.target.value))} />`}
      </div>
    </section>`;
}
