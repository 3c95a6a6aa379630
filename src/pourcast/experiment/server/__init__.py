"""The experiment over HTTP: sessions, answers, and the page of whoever runs it."""
