// The path that the service lies under. The service writes it into the root element of the page.

/** Without a final slash; empty if the service has the host for itself. */
export const basePath = globalThis.document?.documentElement.dataset.basePath ?? '';
