// Where the model cannot be drawn: a sentence and the still picture that the page holds, never a blank page.
export function fallBack(reason) {
  document.documentElement.classList.add("still");
  document.getElementById("sentence").textContent =
    `This browser cannot draw the model (${reason}). The picture is a still; ` +
    "a newer browser, with WebGL2, shows the model from all sides.";
}
