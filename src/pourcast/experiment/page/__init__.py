"""The page of the participants (`web/`, in TypeScript), and what is handed to it."""
