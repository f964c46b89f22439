"""USD scenes in text (USDA), binary (USDC) and archives (USDZ), through OpenUSD."""
