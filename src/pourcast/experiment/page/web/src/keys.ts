/** ENTER that is held down presses one button, and none of the pages that come after it. */
export function pressOnce(event: KeyboardEvent): void {
  const writes = event.target instanceof HTMLTextAreaElement;
  if (event.key === "Enter" && event.repeat && !writes) event.preventDefault();
}
