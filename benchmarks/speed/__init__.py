"""How long methods take, and how much memory."""
