// Words of the model, set as text, never as markup.
export function setCaption(words) {
  for (const [name, text] of Object.entries(words)) document.getElementById(`caption-${name}`).textContent = text;
}
