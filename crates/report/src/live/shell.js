// Asks for the page again and again, and shows what has changed.

const EVERY_MS = 2000;
const now = document.querySelector("#now");
const state = document.querySelector("#state");
let shown = "";

async function look() {
  try {
    const answer = await fetch("now");
    if (!answer.ok) throw new Error(answer.statusText);
    const text = await answer.text();
    if (text !== shown) {
      now.innerHTML = text;
      shown = text;
    }
    state.textContent = `live: read at ${new Date().toLocaleTimeString()}`;
  } catch {
    state.textContent = "The program that serves this page has ended. This is what it showed last.";
  }
  setTimeout(look, EVERY_MS);
}

look();
