// The published browser build is UMD: loaded as a module it leaves `tus` on the global object. This file, ours, hands it on
// as a named export, so that the vendored file stays byte for byte what the registry delivers.
import './tus.min.js';

export const { Upload } = globalThis.tus;
