// The centre as a mark: its logo and name, or the product's where the centre has none.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { useCentre } from '../../centre.js';
import { t } from '../../texts.js';
import { Brand } from './icons.js';

/** The logo of the centre; nothing without one. It is decoration: the name stands beside it. */
export const CentreLogo = ({ version }) => version && html`<img class="centre-logo" src=${api.centre.logoAddress(version)} alt="" />`;

/** For the head of the pages and the sign-in page. @param {{ size?: number }} props */
export function CentreMark({ size }) {
  const { name, logo_version: version } = useCentre();
  return html`
    ${version ? html`<${CentreLogo} version=${version} />` : html`<${Brand} size=${size} />`}
    <span class=${`centre-name ${name ? 'own' : ''}`} title=${name ?? undefined}>${name ?? t.product}</span>`;
}

/** For the head of a printed sheet: without a logo only the name. */
export function CentreLetterhead() {
  const { name, logo_version: version } = useCentre();
  return html`<p class="letterhead"><${CentreLogo} version=${version} /><span>${name ?? t.product}</span></p>`;
}
