"""Looking: scenes, pours and models' judgments as pictures and films; the figures' style."""
